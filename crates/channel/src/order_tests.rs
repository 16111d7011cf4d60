//! Messages out of order, sent on purpose: the receiver rejects each of them.

use std::thread;

use case::Role::{Flow, Mesh, Structure};

use super::common::*;

use crate::header::COUPLER;
use crate::membership::Membership;
use crate::rank_server::RankServer;
use crate::serve::Identity;
use crate::{Header, Hub, HubError, Kind, ServeError, Unit, Window};

type Tamper = fn(&mut Header);

/// A rank that joins correctly and answers its first window with a header changed by `tamper`; returns the reaction
/// of the coupler.
fn answer_with(tamper: Tamper, words: usize) -> String {
    let session = name("rogue");
    let at = at(&session, Structure, 0, 1);
    let thread = thread::spawn(move || {
        let fake = Fake::new(Structure, 0, 1);
        let mut server = RankServer::open(Membership::join(&at, at.deadline)?, Identity::of(&fake))?;
        server.welcome()?;
        server.lay_out()?;
        drop(server.expect(Kind::Advance)?);
        let mut loan = server.answers.loan(words)?;
        loan.payload().fill(1.0);
        let header = server.member.header(Kind::Output, server.sequence);
        let mut header = header.with_window(server.step.1).with_payload(Unit::Displacement, words);
        tamper(&mut header);
        loan.send(header)?;
        server.member.coupler_event.notify();
        server.expect(Kind::Stop).map(drop)
    });
    let mut hub = open(options(&session, &[(Structure, 1)])).expect("a handshake");
    hub.advance(Structure, &window(6, 2), &mut |x| x.fill(0.0)).expect("sent");
    let mut used = false;
    let result = hub.collect(Structure, &mut |_, _| used = true, &mut time_limit());
    let text = match result {
        Ok(_) => "accepted".to_string(),
        Err(error) => {
            assert!(matches!(error, HubError::Contract { .. }), "{error}");
            assert!(!used, "the data were used: {error}");
            error.to_string()
        }
    };
    drop(hub);
    assert!(thread.join().expect("no panic").is_err(), "it is informed that the run has ended");
    text
}

#[test]
fn coupler_uses_no_response_out_of_order() {
    let all = NODES * 3;
    assert_eq!(answer_with(|_| {}, all), "accepted", "the rogue is honest up to its header");
    let cases: [(Tamper, usize, &str); 11] = [
        (|h| h.window.iteration -= 1, all, "it answered window 6 iteration 1"),
        (|h| h.window.index += 1, all, "it answered window 7 iteration 2"),
        (|h| h.sequence -= 1, all, "it answers command 2, expected 3"),
        (|h| h.session ^= 1, all, "session"),
        (|h| h.contract += 1, all, "contract version"),
        (|h| h.rank = 1, all, "sender"),
        (|h| h.kind = Kind::Done as u32, all, "Done in unit 3, expected Output"),
        (|h| h.kind = 77, all, "an unknown kind"),
        (|h| h.unit = Unit::Load as u32, all, "unit 4, expected Output in unit Displacement"),
        (|h| h.length += 1, all, "length"),
        (|_| {}, all - 3, "102 numbers, expected 105"),
    ];
    for (tamper, words, expected) in cases {
        let text = answer_with(tamper, words);
        assert!(text.contains(expected) && text.contains("structure-solver (rank 0)"), "{text} / {expected}");
    }
}

#[test]
fn participant_executes_no_command_out_of_order() {
    type Change = fn(&mut Hub);
    let cases: [(Change, &str); 5] = [
        (|hub| hub.programs[0].sequence += 3, "command 7 after command 3"),
        (|hub| hub.programs[0].sequence -= 1, "command 3 after command 3"),
        (|hub| hub.id ^= 1, "session"),
        (|hub| hub.programs[0].input_length -= 1, "input of 191 numbers"),
        (
            |hub| hub.send_command(&[Structure], Kind::Welcome, &Window::default(), "").expect("sent"),
            "unexpected command `Welcome` between windows",
        ),
    ];
    for (tamper, expected) in cases {
        let session = name("tamper");
        let served = spawn(&session, Fake::new(Structure, 0, 1));
        let mut hub = open(options(&session, &[(Structure, 1)])).expect("a handshake");
        hub.advance(Structure, &window(0, 0), &mut |x| x.fill(1.0)).expect("sent");
        gather(&mut hub, Structure).expect("an answer");
        tamper(&mut hub);
        let _ = hub.advance(Structure, &window(0, 1), &mut |x| x.fill(1.0));
        let end = served.join().expect("no panic").expect_err(expected);
        assert!(matches!(&end, ServeError::Contract { .. }), "{end}");
        assert!(end.to_string().contains(expected), "{end} / {expected}");
    }
}

#[test]
fn flow_reads_no_grid_out_of_order() {
    let cases: [(Tamper, usize, f64, &str); 5] = [
        (|h| h.window.iteration += 1, GRID * 6, 1.0, "is ahead, in window 6 iteration 3"),
        (|h| h.window.index += 1, GRID * 6, 1.0, "is ahead, in window 7"),
        (|h| h.session ^= 1, GRID * 6, 1.0, "session"),
        (|_| {}, GRID * 6 - 6, 1.0, "600 numbers, expected 606"),
        (|_| {}, GRID * 6, f64::NAN, "row 0 of the grid of the mesh-mover (rank 0) holds NaN"),
    ];
    for (tamper, words, fill, expected) in cases {
        let session = name("grid");
        let flow = spawn(&session, Fake::new(Flow, 0, 1));
        let at = at(&session, Mesh, 0, 1);
        let mesh = thread::spawn(move || {
            let fake = Fake::new(Mesh, 0, 1);
            let mut server = RankServer::open(Membership::join(&at, at.deadline)?, Identity::of(&fake))?;
            server.welcome()?;
            server.lay_out()?;
            drop(server.expect(Kind::Advance)?);
            let mut loan = server.grid_out.as_ref().expect("the mesh has one").loan(words)?;
            loan.payload().fill(fill);
            let header = server.member.header(Kind::Grid, server.sequence);
            let mut header = header.with_window(server.step.1).with_payload(Unit::Grid, words);
            tamper(&mut header);
            loan.send(header)?;
            server.member.notify_readers();
            server.expect(Kind::Stop).map(drop)
        });
        let mut hub = open(options(&session, &[(Mesh, 1), (Flow, 1)])).expect("a handshake");
        for role in [Mesh, Flow] {
            hub.advance(role, &window(6, 2), &mut |x| x.fill(0.0)).expect("sent");
        }
        let error = gather(&mut hub, Flow).expect_err(expected).to_string();
        assert!(error.contains("flow-solver (rank 0)") && error.contains(expected), "{error} / {expected}");
        drop(hub);
        assert!(flow.join().expect("no panic").is_err());
        assert!(mesh.join().expect("no panic").is_err());
    }
}

/// A coupler that does not check its messages.
#[test]
fn participant_rejects_input_that_is_not_finite() {
    for wrong in [f64::NAN, f64::INFINITY] {
        let session = name("nan");
        let served = spawn(&session, Fake::new(Structure, 0, 1));
        let hub = open(options(&session, &[(Structure, 1)])).expect("a handshake");
        let program = &hub.programs[0];
        let sender = program.command.as_ref().expect("it was welcomed");
        let words = program.input_length;
        let mut loan = sender.loan(words).expect("memory");
        loan.payload().fill(1.0);
        loan.payload()[11] = wrong;
        let header = Header::new(Kind::Advance, hub.id, COUPLER, 0, program.sequence + 1);
        loan.send(header.with_window(window(0, 0)).with_payload(Unit::LoadPair, words)).expect("sent");
        program.wake_event.notify();
        let end = served.join().expect("no panic").expect_err("refused").to_string();
        assert!(end.contains(&format!("component 3 of row 1 of the input is {wrong}")), "{end}");
        drop(hub);
        channel::cleanup(&session).expect("all have ended");
    }
}
