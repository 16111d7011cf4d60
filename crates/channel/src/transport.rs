//! Shared memory between processes: the only module that names iceoryx2.
//!
//! A *channel* has one sender and a fixed number of receivers; payloads are slices of `f64` under a [`Header`],
//! written and read in place. A *wake event* wakes processes that sleep in the kernel. No call blocks until a
//! receiver has free space: the contract is lock-step, so a message that does not fit is an error.

use std::cell::RefCell;
use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};

use crate::deadline::Deadline;
use crate::header::{Header, pack_text, text_words};
use crate::session::{SessionPaths, memory_for};
use crate::{CONTRACT_VERSION, SessionError};

type Ipc = ipc::Service;

// SAFETY: `Header` is `repr(C)`, holds numbers only (no pointers, no padding: a
// test adds up its fields), and every bit pattern of it is valid.
unsafe impl ZeroCopySend for Header {
    // The version makes iceoryx2 refuse a process that was built with another contract.
    unsafe fn type_name() -> &'static str {
        HEADER_TYPE
    }
}

/// Name of the header's type in the transport, in any language.
pub(crate) const HEADER_TYPE: &str = "ripstop.Header.v5";
const _: () = assert!(CONTRACT_VERSION == 5, "HEADER_TYPE must follow CONTRACT_VERSION");

/// A process's (or, in tests, thread's) connection to a session.
pub(crate) struct Connection {
    node: Node<Ipc>,
}

/// Sizes of a channel; both ends must state the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChannelSpec {
    /// Largest number of receivers.
    pub receivers: usize,
    /// The newest message replaces an unread one. Otherwise it is rejected.
    pub newest_wins: bool,
}

pub(crate) struct Channel {
    name: String,
    service: publish_subscribe::PortFactory<Ipc, [f64], Header>,
    receivers: usize,
}

/// Messages that a receiver can hold unread, and hold borrowed.
pub(crate) const BUFFER: usize = 2;
/// Alignment of payloads, bytes.
pub(crate) const ALIGNMENT: usize = 64;

fn failed<E: std::fmt::Debug>(what: &str) -> impl FnOnce(E) -> SessionError {
    let what = what.to_string();
    move |e| SessionError::Transport { what, problem: format!("{e:?}") }
}

impl Connection {
    pub fn new(place: &SessionPaths, name: &str) -> Result<Self, SessionError> {
        set_log_level_from_env_or(LogLevel::Fatal);
        let mut config = Config::default();
        config.global.prefix = FileName::new(place.prefix().as_bytes()).map_err(failed("prefix"))?;
        let folder = place.folder();
        let folder = Path::new(folder.as_os_str().as_encoded_bytes()).map_err(failed("folder"))?;
        config.global.set_root_path(&folder);
        // A session is removed as a whole when its last process has ended: no process cleans up after another while
        // data may still be read.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let node = NodeBuilder::new()
            .name(&name.try_into().map_err(failed("node name"))?)
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(failed(&format!("node `{name}`")))?;
        Ok(Self { node })
    }

    /// Creates a channel (coupler).
    pub fn create(&self, name: &str, spec: ChannelSpec) -> Result<Channel, SessionError> {
        self.channel(name, spec, true)
    }

    /// Joins a channel (participant).
    pub fn join(&self, name: &str, spec: ChannelSpec) -> Result<Channel, SessionError> {
        self.channel(name, spec, false)
    }

    fn channel(&self, name: &str, spec: ChannelSpec, create: bool) -> Result<Channel, SessionError> {
        let builder = self
            .node
            .service_builder(&name.try_into().map_err(failed(name))?)
            .publish_subscribe::<[f64]>()
            .user_header::<Header>()
            .payload_alignment(Alignment::new(ALIGNMENT).expect("a power of two"))
            .max_publishers(1)
            .max_subscribers(spec.receivers)
            .max_nodes(spec.receivers + 2)
            .subscriber_max_buffer_size(BUFFER)
            .subscriber_max_borrowed_samples(BUFFER)
            .history_size(0)
            .enable_safe_overflow(spec.newest_wins);
        let service = if create {
            builder.create().map_err(failed(name))?
        } else {
            builder.open().map_err(failed(name))?
        };
        Ok(Channel { name: name.into(), service, receivers: spec.receivers })
    }

    /// Creates a wake event (coupler).
    pub fn create_event(
        &self,
        name: &str,
        listeners: usize,
        notifiers: usize,
    ) -> Result<WakeEvent, SessionError> {
        self.wake_event(name, listeners, notifiers, true)
    }

    /// Joins a wake event (participant).
    pub fn join_event(
        &self,
        name: &str,
        listeners: usize,
        notifiers: usize,
    ) -> Result<WakeEvent, SessionError> {
        self.wake_event(name, listeners, notifiers, false)
    }

    fn wake_event(
        &self,
        name: &str,
        listeners: usize,
        notifiers: usize,
        create: bool,
    ) -> Result<WakeEvent, SessionError> {
        let builder = self
            .node
            .service_builder(&name.try_into().map_err(failed(name))?)
            .event()
            .max_listeners(listeners)
            .max_notifiers(notifiers)
            .max_nodes(listeners + notifiers + 1)
            .event_id_max_value(1);
        let service = if create {
            builder.create().map_err(failed(name))?
        } else {
            builder.open().map_err(failed(name))?
        };
        Ok(WakeEvent { name: name.into(), service })
    }
}

impl Channel {
    /// The sending end for messages of at most `words` numbers.
    pub fn sender(&self, words: usize) -> Result<Sender, SessionError> {
        // Memory is allocated page by page when it is written: running out of it then would kill the process without
        // a message.
        memory_for(&self.name, 3 * 8 * words as u64)?;
        let publisher = self
            .service
            .publisher_builder()
            .initial_max_slice_len(words)
            // One that is written, one prepared for the next message.
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            // In lock-step at most: one borrowed, two unread, one replaced, two loaned.
            .override_sample_preallocation(|worst| worst.min(2 * BUFFER + 2))
            .create()
            .map_err(failed(&format!("sending on `{}`", self.name)))?;
        Ok(Sender { name: self.name.clone(), prepared: RefCell::default(), publisher, words })
    }

    pub fn receiver(&self) -> Result<Receiver, SessionError> {
        let subscriber = self
            .service
            .subscriber_builder()
            .create()
            .map_err(failed(&format!("receiving on `{}` ({} places)", self.name, self.receivers)))?;
        Ok(Receiver { name: self.name.clone(), subscriber })
    }
}

pub(crate) struct Sender {
    name: String,
    /// Memory for the next message, by [`Sender::prepare`].
    prepared: RefCell<Option<Sample>>,
    publisher: Publisher<Ipc, [f64], Header>,
    /// Numbers in the longest message.
    pub words: usize,
}

/// A message in shared memory that is being written.
pub(crate) struct Loan {
    name: String,
    sample: Sample,
}

type Sample = iceoryx2::sample_mut::SampleMut<Ipc, [f64], Header>;

impl Sender {
    /// Shared memory for a message of `words` numbers, initialised to NaN, so that values that were not written are
    /// detected.
    pub fn loan(&self, words: usize) -> Result<Loan, SessionError> {
        let prepared = self.prepared.take().filter(|sample| sample.payload().len() == words);
        let sample = prepared.map_or_else(|| self.without_values(words), Ok)?;
        Ok(Loan { name: self.name.clone(), sample })
    }

    /// Prepares the next message, of `words` numbers, while the other side works: [`Sender::loan`] then takes no time.
    pub fn prepare(&self, words: usize) {
        // Whatever keeps this from working is reported when the message is needed.
        let prepared = self.prepared.take().filter(|sample| sample.payload().len() == words);
        self.prepared.replace(prepared.or_else(|| self.without_values(words).ok()));
    }

    fn without_values(&self, words: usize) -> Result<Sample, SessionError> {
        let memory = self.publisher.loan_slice_uninit(words);
        let memory = memory.map_err(failed(&format!("{words} numbers on `{}`", self.name)))?;
        Ok(memory.write_from_fn(|_| f64::NAN))
    }

    /// Sends a message without numbers. Returns the number of receivers.
    pub fn send(&self, header: Header) -> Result<usize, SessionError> {
        self.loan(0)?.send(header)
    }

    /// Sends a text, truncated to the size of the channel. Returns the number of receivers.
    pub fn send_text(&self, header: Header, text: &str) -> Result<usize, SessionError> {
        let text = crate::header::truncate(text, self.words * 8);
        let words = text_words(text);
        let mut loan = self.loan(words)?;
        pack_text(text, loan.payload());
        let mut header = header.with_payload(crate::header::Unit::Text, words);
        header.bytes = text.len() as u64;
        loan.send(header)
    }
}

impl Loan {
    pub fn payload(&mut self) -> &mut [f64] {
        self.sample.payload_mut()
    }

    /// Sends the message. Returns the number of receivers.
    pub fn send(mut self, header: Header) -> Result<usize, SessionError> {
        *self.sample.user_header_mut() = header;
        self.sample.send().map_err(failed(&format!("sending on `{}`", self.name)))
    }
}

pub(crate) struct Receiver {
    name: String,
    subscriber: Subscriber<Ipc, [f64], Header>,
}

/// A received message, borrowed from shared memory until dropped.
pub(crate) struct Message(iceoryx2::sample::Sample<Ipc, [f64], Header>);

impl Receiver {
    /// The next message, if one is there.
    pub fn receive(&self) -> Result<Option<Message>, SessionError> {
        let sample = self.subscriber.receive().map_err(failed(&format!("receiving on `{}`", self.name)))?;
        Ok(sample.map(Message))
    }
}

impl Message {
    /// The header as sent, unchecked.
    pub fn header(&self) -> &Header {
        self.0.user_header()
    }

    pub fn payload(&self) -> &[f64] {
        self.0.payload()
    }
}

pub(crate) struct WakeEvent {
    name: String,
    service: event::PortFactory<Ipc>,
}

impl WakeEvent {
    pub fn listener(&self) -> Result<WakeListener, SessionError> {
        let listener = self.service.listener_builder().create();
        listener.map(WakeListener).map_err(failed(&format!("listening to `{}`", self.name)))
    }

    pub fn notifier(&self) -> Result<WakeNotifier, SessionError> {
        let notifier = self.service.notifier_builder().create();
        notifier.map(WakeNotifier).map_err(failed(&format!("notifying `{}`", self.name)))
    }
}

/// Sleeps in the kernel until notified.
pub(crate) struct WakeListener(Listener<Ipc>);

impl WakeListener {
    /// Returns after a notification, or after `limit`. An earlier notification counts.
    pub fn sleep(&self, limit: Duration) -> Result<(), SessionError> {
        let end = Deadline::after(limit);
        loop {
            let left = end.left(limit);
            // The socket would interpret a limit below its resolution as infinite.
            if left < Duration::from_micros(100) {
                return match self.0.try_wait(|_| {}) {
                    Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
                    Err(e) => Err(failed("sleeping")(e)),
                };
            }
            match self.0.timed_wait(|_| {}, left) {
                // May return early without a notification.
                Ok(0) => {}
                // A signal is handled by the caller, who polls again.
                Ok(_) | Err(ListenerWaitError::InterruptSignal) => return Ok(()),
                Err(e) => return Err(failed("sleeping")(e)),
            }
        }
    }
}

/// Wakes the listeners of an event.
pub(crate) struct WakeNotifier(Notifier<Ipc>);

impl WakeNotifier {
    /// A listener that has ended is not an error here: its lock is checked elsewhere.
    pub fn notify(&self) {
        let _ = self.0.notify();
    }
}
