//! Which program the others wait for in a stage, and which numbers of ranks would make the stage faster, by how much.
//!
//! The programs take turns: while one computes, the others sleep, so the ranks of each may use all cores. The work of a
//! program is what its ranks computed without waiting for each other. On other numbers of ranks it takes between that work
//! divided evenly and that divided at the lowest parallel efficiency of `docs/records/benchmarks.md`.

use case::{Integration, Role, Scene, Stage};
use serde::{Deserialize, Serialize};

use crate::summary::StageSummary;

/// Shortest wall time of a stage that is advised on, s: below, times are mostly noise.
const SHORTEST_STAGE_S: f64 = 10.0;
/// Least gain over the wall time that is advised, middle of its range.
const LEAST_GAIN: f64 = 0.05;
/// Least gain of one program over the wall time for which its ranks change.
const LEAST_GAIN_OF_A_PROGRAM: f64 = 0.02;
/// Share of a program's time in which its ranks wait for each other that is worth a line.
const MUCH_WAITING: f64 = 0.3;
/// Largest number of ranks whose efficiency was measured.
const MOST_RANKS: u32 = 16;

/// How a program was measured to scale.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scaling {
    /// Lowest parallel efficiency on 2, 4, 8 and 16 ranks.
    efficiency: [f64; 4],
    /// Shortest time of a rank in a solve for which it was measured, s.
    shortest_solve_s: f64,
}

// "What advice on ranks uses" of docs/records/benchmarks.md.
const EXPLICIT: Scaling = Scaling { efficiency: [0.93, 0.83, 0.73, 0.63], shortest_solve_s: 0.008 };
const IMPLICIT: Scaling = Scaling { efficiency: [0.82, 0.71, 0.49, 0.49], shortest_solve_s: 0.018 };
const FITTED: Scaling = Scaling { efficiency: [0.72, 0.65, 0.65, 0.44], shortest_solve_s: 0.035 };
const IMMERSED: Scaling = Scaling { efficiency: [0.62, 0.61, 0.41, 0.23], shortest_solve_s: 0.05 };
const MOVER: Scaling = Scaling { efficiency: [0.79, 0.79, 0.66, 0.61], shortest_solve_s: 0.017 };

impl Scaling {
    /// That of the program of `role` in a stage; `None` where it runs on a GPU.
    fn of(scene: &Scene, stage: &Stage, role: Role) -> Option<Self> {
        match role {
            Role::Structure if scene.structure.integration == Integration::Explicit => Some(EXPLICIT),
            Role::Structure => Some(IMPLICIT),
            Role::Mesh => Some(MOVER),
            Role::Flow if !scene.is_immersed(stage) => Some(FITTED),
            Role::Flow => {
                let immersed = scene.flow.as_ref()?.immersed.as_ref()?;
                (immersed.device == case::FlowDevice::Cpu).then_some(IMMERSED)
            }
        }
    }

    /// Lowest efficiency on `ranks`: that of the next larger number that was measured.
    fn lowest(&self, ranks: u32) -> f64 {
        match ranks {
            0 | 1 => 1.0,
            2 => self.efficiency[0],
            3..=4 => self.efficiency[1],
            5..=8 => self.efficiency[2],
            _ => self.efficiency[3],
        }
    }
}

/// What a program did in a stage.
#[derive(Clone, Copy, Debug)]
struct Work {
    ranks: u32,
    busy_s: f64,
    /// Mean over its ranks of the time in which they waited for each other, s.
    waited_s: f64,
    solves: u64,
    /// `None`: its ranks stay.
    scaling: Option<Scaling>,
}

impl Work {
    /// Least and most seconds on `ranks`.
    fn seconds_on(&self, ranks: u32) -> [f64; 2] {
        let Some(scaling) = self.scaling.filter(|_| ranks != self.ranks) else { return [self.busy_s; 2] };
        let even = self.work_s() / f64::from(ranks);
        [even, even / scaling.lowest(ranks)]
    }

    /// Seconds that all ranks computed.
    fn work_s(&self) -> f64 {
        (self.busy_s - self.waited_s).max(0.0) * f64::from(self.ranks)
    }

    /// Whether solves on `ranks` are as long as measured ones.
    fn was_measured(&self, ranks: u32) -> bool {
        let of_a_rank = self.work_s() / (self.solves.max(1) as f64 * f64::from(ranks));
        ranks == 1 || self.scaling.is_some_and(|s| of_a_rank >= s.shortest_solve_s)
    }

    /// The number of ranks on at most `cores` with the smallest time; its own where none gains `least_s`.
    fn fastest(&self, cores: u32, least_s: f64) -> u32 {
        let most = cores.min(MOST_RANKS);
        let middle = |ranks: u32| self.seconds_on(ranks).iter().sum::<f64>() / 2.0;
        let candidates = [1, 2, 4, 8, 16, most].into_iter();
        let allowed = candidates.filter(|&n| n <= most && self.was_measured(n));
        allowed
            .filter(|&n| middle(self.ranks) - middle(n) > least_s)
            .min_by(|a, b| middle(*a).total_cmp(&middle(*b)))
            .unwrap_or(self.ranks)
    }
}

/// Numbers of ranks on which a stage is expected to be faster.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RankAdvice {
    /// Ranks of structure, flow, mesh.
    pub ranks: [u32; 3],
    /// Least and most wall time of the stage with them, relative to that of this run.
    pub wall_ratio: [f64; 2],
}

impl RankAdvice {
    /// Advice for a stage that took `wall_s` on `cores`; `None` where no numbers are clearly faster.
    fn of_works(works: &[Work; 3], wall_s: f64, cores: u32) -> Option<Self> {
        let ranks = works.map(|w| w.fastest(cores, LEAST_GAIN_OF_A_PROGRAM * wall_s));
        let wall_ratio = [0, 1].map(|bound| {
            let saved = works.iter().zip(ranks).map(|(w, n)| w.busy_s - w.seconds_on(n)[bound]);
            1.0 - saved.sum::<f64>() / wall_s
        });
        let gain = 1.0 - 0.5 * (wall_ratio[0] + wall_ratio[1]);
        (gain >= LEAST_GAIN).then_some(Self { ranks, wall_ratio })
    }

    /// Advice for a stage of `scene` on `cores`, whose programs of `fixed` are not those of the project.
    pub fn of(stage: &StageSummary, scene: &Scene, cores: usize, fixed: &[Role]) -> Option<Self> {
        let description = scene.stages.iter().find(|s| s.name == stage.name)?;
        let runs = |role: &Role| scene.roles(description).contains(role);
        let works = Role::ALL.map(|role| Work {
            ranks: scene.ranks.of(role),
            busy_s: stage.busy_s(role),
            waited_s: stage.rank_waiting_s[role as usize],
            solves: stage.solves(role),
            scaling: Scaling::of(scene, description, role).filter(|_| runs(&role) && !fixed.contains(&role)),
        });
        let cores = u32::try_from(cores).unwrap_or(MOST_RANKS);
        Self::of_works(&works, stage.wall_s, cores).filter(|_| stage.wall_s >= SHORTEST_STAGE_S)
    }

    /// In words, after the name of the stage: of a run on `ranks`.
    pub fn line(&self, ranks: [u32; 3]) -> String {
        let changed = Role::ALL.into_iter().filter(|r| self.ranks[*r as usize] != ranks[*r as usize]);
        let split: Vec<_> = changed.map(|r| format!("{}={}", r.name(), self.ranks[r as usize])).collect();
        let [least, most] = self.wall_ratio;
        format!(
            "--ranks {} would take {least:.2} to {most:.2} of the time, from the same work divided evenly to the lowest efficiency \
             of docs/records/benchmarks.md; not assessed: another number of iterations, other load on the cores",
            split.join(",")
        )
    }
}

/// Which program the others wait for, whose ranks wait for each other, and what other ranks would change; `None` where neither is much.
pub fn line(stage: &StageSummary, ranks: [u32; 3]) -> Option<String> {
    let share = |part: f64, whole: f64| 100.0 * part / whole.max(f64::MIN_POSITIVE);
    let waiting = Role::ALL.into_iter().filter_map(|role| {
        let (waited, busy) = (stage.rank_waiting_s[role as usize], stage.busy_s(role));
        let much = stage.wall_s >= SHORTEST_STAGE_S
            && waited > MUCH_WAITING * busy
            && busy > LEAST_GAIN * stage.wall_s;
        much.then(|| {
            let (n, share) = (ranks[role as usize], share(waited, busy));
            format!("the {n} ranks of the {} wait for each other in {share:.0} % of its time", role.program())
        })
    });
    let slowest = Role::ALL
        .into_iter()
        .max_by(|a, b| stage.busy_s(*a).total_cmp(&stage.busy_s(*b)))
        .filter(|_| stage.rank_advice.is_some());
    let waited_for = slowest.map(|role| {
        let share = share(stage.busy_s(role), stage.wall_s);
        format!("the others wait for the {} in {share:.0} % of the wall time", role.program())
    });
    let parts: Vec<_> =
        waited_for.into_iter().chain(waiting).chain(stage.rank_advice.map(|a| a.line(ranks))).collect();
    (!parts.is_empty()).then(|| format!("{}: ranks: {}", stage.name, parts.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(ranks: u32, busy_s: f64, waited_s: f64, scaling: Scaling) -> Work {
        Work { ranks, busy_s, waited_s, solves: 100, scaling: Some(scaling) }
    }

    /// A flow of 60 s in a stage of 100 s: on two ranks 30 to 41.7 s. The structure's 1 s and a mover of 4 s do not pay.
    #[test]
    fn program_with_most_of_the_work_is_divided() {
        let works = [work(1, 1.0, 0.0, IMPLICIT), work(1, 60.0, 0.0, FITTED), work(1, 3.0, 0.0, MOVER)];
        let advice = RankAdvice::of_works(&works, 100.0, 2).expect("advice");
        assert_eq!(advice.ranks, [1, 2, 1]);
        assert!((advice.wall_ratio[0] - 0.70).abs() < 1e-12, "{advice:?}");
        assert!((advice.wall_ratio[1] - (0.4 + 0.3 / 0.72)).abs() < 1e-12, "{advice:?}");
        let line = advice.line([1; 3]);
        assert!(line.starts_with("--ranks flow=2 would take 0.70 to 0.82 of the time"), "{line}");
        // Solves of 0.3 s: 16 ranks have 19 ms each, less than was measured.
        let works = [works[0], Work { solves: 200, ..works[1] }, works[2]];
        assert_eq!(RankAdvice::of_works(&works, 100.0, 64).expect("advice").ranks, [1, 8, 1]);
        // A number of cores that is no power of two.
        assert_eq!(RankAdvice::of_works(&works, 100.0, 6).expect("advice").ranks, [1, 6, 1]);
        assert_eq!(RankAdvice::of_works(&works, 100.0, 1), None);
    }

    /// Two ranks that wait for 70 % of the time computed 0.6 s each second: one rank does the same work in 0.6 of the time.
    #[test]
    fn ranks_that_mostly_wait_are_given_up() {
        let works = [work(1, 0.0, 0.0, IMPLICIT), work(2, 50.0, 35.0, IMMERSED), work(1, 0.0, 0.0, MOVER)];
        let advice = RankAdvice::of_works(&works, 60.0, 1).expect("advice");
        assert_eq!(advice.ranks, [1, 1, 1]);
        assert!(advice.wall_ratio.iter().all(|r| (r - (1.0 - 20.0 / 60.0)).abs() < 1e-12), "{advice:?}");
        // Evenly divided work stays.
        let works = [works[0], work(2, 50.0, 2.0, IMMERSED), works[2]];
        assert_eq!(RankAdvice::of_works(&works, 60.0, 2), None);
        assert_eq!(RankAdvice::of_works(&works, 60.0, 1), None);
    }

    #[test]
    fn programs_of_others_and_short_solves_keep_their_ranks() {
        let none = work(1, 0.0, 0.0, IMPLICIT);
        let other = Work { scaling: None, ..work(1, 60.0, 0.0, FITTED) };
        assert_eq!(RankAdvice::of_works(&[none, other, none], 100.0, 8), None);
        let short = Work { solves: 100_000, ..work(1, 60.0, 0.0, FITTED) };
        assert_eq!(RankAdvice::of_works(&[none, short, none], 100.0, 8), None);
    }

    /// The text of a stage, and of one that is too short.
    #[test]
    fn summary_says_who_waits() {
        let scene = case::parse(
            std::path::Path::new("scene.toml"),
            include_str!("../../../cases/atps-descent/scene.toml"),
        )
        .expect("a scene");
        let stage = scene.stages.last().expect("a stage");
        let mut summary = StageSummary {
            wall_s: 100.0,
            structure_busy_s: 1.0,
            flow_busy_s: 80.0,
            mesh_busy_s: 1.0,
            flow_solves: 100,
            rank_waiting_s: [0.0, 40.0, 0.0],
            ..StageSummary::new(stage)
        };
        summary.rank_advice = RankAdvice::of(&summary, &scene, 8, &[]);
        let text = line(&summary, [1, 2, 2]).expect("a line");
        let start = "descent: ranks: the others wait for the flow-solver in 80 % of the wall time; the 2 ranks of the flow-solver \
                     wait for each other in 50 % of its time; --ranks flow=8 would take 0.30 to 0.35 of the time";
        assert!(text.starts_with(start), "{text}");
        assert_eq!(RankAdvice::of(&summary, &scene, 8, &[Role::Flow]), None);
        summary.wall_s = 9.0;
        summary.rank_advice = RankAdvice::of(&summary, &scene, 8, &[]);
        assert_eq!(line(&summary, [1, 2, 2]), None);
    }
}
