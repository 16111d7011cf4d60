//! The state of an accepted window, and the file that keeps it.

use std::borrow::Cow;
use std::path::Path;

use channel::Fault;
use immersed::axis::Axis;
use immersed::flow::{Flow, FlowState};
use immersed::grid::{End, Ends, Grid, Velocity};
use immersed::wall_rates::WallRates;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

const KIND: [u8; 8] = *b"RIPIMMER";
const VERSION: u32 = 4;

/// One axis of a grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SavedAxis {
    faces: Vec<f64>,
    widths: Vec<f64>,
    core: [u64; 2],
    spacing: f64,
    /// Conditions at the ends: 0 inflow, 1 slip, 2 outflow.
    ends: [u8; 2],
}

/// State of an accepted window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved<'a> {
    axes: Vec<SavedAxis>,
    /// Staggered velocity and the rates of the step before, with ghosts: of the flow that is saved, or own ones where they were read.
    velocity: Cow<'a, [Vec<f64>]>,
    rates: Cow<'a, [Vec<f64>]>,
    previous_dt: Option<f64>,
    jump: Vec<f64>,
    /// Component, position and rate (m/s2) of the values next to the canopy in a viscous flow.
    wall_rates: Vec<(u8, u32, f64)>,
    /// Positions of the canopy, m, their velocities, m/s.
    pub positions: Vec<[f64; 3]>,
    pub velocities: Vec<[f64; 3]>,
    /// Vertices of the last cut in coordinates of the grid, m; empty before the first.
    pub vertices: Vec<[f64; 3]>,
    /// Mean force of the air along each face of the canopy, N.
    pub along: Vec<[f64; 3]>,
    /// Origin of the grid, and place of the middle of the canopy in it, m.
    pub origin: [f64; 3],
    pub home: [f64; 3],
    pub new_grids: u32,
    /// Velocity of the frame, m/s.
    pub frame: [f64; 3],
    /// Height of its origin above ground, m, where the wind changes with height.
    pub height: Option<f64>,
}

/// What a [`Saved`] consists of besides flow and grid.
pub struct Kinematics {
    pub positions: Vec<Vector3<f64>>,
    pub velocities: Vec<Vector3<f64>>,
    pub vertices: Vec<Vector3<f64>>,
    pub along: Vec<Vector3<f64>>,
    pub origin: Vector3<f64>,
    pub home: Vector3<f64>,
    pub new_grids: u32,
    pub frame: Vector3<f64>,
    pub height: Option<f64>,
}

fn rows(values: &[Vector3<f64>]) -> Vec<[f64; 3]> {
    values.iter().map(|v| (*v).into()).collect()
}

fn vectors(rows: &[[f64; 3]]) -> Vec<Vector3<f64>> {
    rows.iter().map(|r| Vector3::from(*r)).collect()
}

impl<'a> Saved<'a> {
    /// Of an accepted window with the pressure jumps `jump`, Pa.
    pub fn new(flow: &'a Flow, jump: Vec<f64>, motion: &Kinematics) -> Self {
        let grid = &flow.grid;
        let (rates, previous_dt) = flow.last_step();
        let axis = |d: usize| {
            let a = &grid.axes[d];
            let ends = match grid.ends[d] {
                Ends::Open(ends) => ends.map(|e| match e {
                    End::Inflow => 0,
                    End::Slip => 1,
                    End::Outflow => 2,
                }),
                Ends::Periodic => unreachable!("the grid around a canopy is open"),
            };
            SavedAxis {
                faces: a.faces.clone(),
                widths: a.widths.clone(),
                core: [a.core.start as u64, a.core.end as u64],
                spacing: a.spacing,
                ends,
            }
        };
        Self {
            axes: (0..3).map(axis).collect(),
            velocity: Cow::Borrowed(&flow.velocity),
            rates: Cow::Borrowed(rates),
            previous_dt,
            jump,
            wall_rates: flow.wall_rates().iter().map(|((c, at), rate)| (c, at, rate)).collect(),
            positions: rows(&motion.positions),
            velocities: rows(&motion.velocities),
            vertices: rows(&motion.vertices),
            along: rows(&motion.along),
            origin: motion.origin.into(),
            home: motion.home.into(),
            new_grids: motion.new_grids,
            frame: motion.frame.into(),
            height: motion.height,
        }
    }

    /// Grid, flow and motion of the canopy.
    ///
    /// # Errors
    /// What does not fit together, in words.
    pub fn parts(self, nodes: usize, vertices: usize) -> Result<(Grid, FlowState, Kinematics), String> {
        let grid = grid(&self.axes)?;
        let motion = Kinematics {
            positions: vectors(&self.positions),
            velocities: vectors(&self.velocities),
            vertices: vectors(&self.vertices),
            along: vectors(&self.along),
            origin: self.origin.into(),
            home: self.home.into(),
            new_grids: self.new_grids,
            frame: self.frame.into(),
            height: self.height,
        };
        if motion.positions.len() != nodes
            || motion.velocities.len() != nodes
            || !(motion.vertices.is_empty() || motion.vertices.len() == vertices)
        {
            return Err(format!("has {} nodes of the canopy, this scene {nodes}", motion.positions.len()));
        }
        let finite = |u: &[Vec<f64>]| {
            u.len() == 3 && u.iter().all(|c| c.len() == grid.array_len() && c.iter().all(|x| x.is_finite()))
        };
        if !finite(&self.velocity) || !finite(&self.rates) || !self.jump.iter().all(|j| j.is_finite()) {
            return Err("has velocities that are not finite numbers or not of its grid".into());
        }
        let is_value =
            |(c, at, rate): &(u8, u32, f64)| *c < 3 && (*at as usize) < grid.array_len() && rate.is_finite();
        let ascending = self.wall_rates.is_sorted_by(|a, b| (a.0, a.1) < (b.0, b.1));
        if !self.wall_rates.iter().all(is_value) || !ascending {
            return Err("has rates next to the canopy that are not finite numbers or not of its grid".into());
        }
        let all =
            motion.positions.iter().chain(&motion.velocities).chain(&motion.vertices).chain(&motion.along);
        if !all.chain([&motion.origin, &motion.home, &motion.frame]).all(|x| x.iter().all(|x| x.is_finite()))
        {
            return Err("has positions or forces that are not finite numbers".into());
        }
        let (values, rates) = self.wall_rates.iter().map(|(c, at, rate)| ((*c, *at), *rate)).unzip();
        let three = |u: Cow<'_, [Vec<f64>]>| Velocity::try_from(u.into_owned()).expect("three components");
        let flow = FlowState {
            velocity: three(self.velocity),
            rates: three(self.rates),
            previous_dt: self.previous_dt,
            jump: self.jump,
            wall_rates: WallRates::new(values, rates),
        };
        Ok((grid, flow, motion))
    }

    /// Grid, velocity relative to the wind (m/s) and the origin of the grid in the falling frame (m), for a start on another grid.
    ///
    /// # Errors
    /// What does not fit together, in words.
    pub fn field(self) -> Result<(Grid, Velocity, Vector3<f64>), String> {
        let grid = grid(&self.axes)?;
        let finite = |c: &Vec<f64>| c.len() == grid.array_len() && c.iter().all(|x| x.is_finite());
        if !self.velocity.iter().all(finite) || !self.origin.iter().all(|x| x.is_finite()) {
            return Err("has velocities that are not finite numbers or not of its grid".into());
        }
        let velocity = Velocity::try_from(self.velocity.into_owned());
        Ok((grid, velocity.map_err(|_| "has no three components of the velocity")?, self.origin.into()))
    }

    /// Writes the state.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, file: &Path) -> Result<(), Fault> {
        archive::save(file, KIND, VERSION, self)
            .map(|_| ())
            .map_err(|e| Fault::new(format!("flow state: {e}")))
    }

    /// Reads a state.
    ///
    /// # Errors
    /// A file that is missing, damaged, or that the flow on a fitted grid wrote.
    pub fn load(file: &Path) -> Result<Self, Fault> {
        archive::load(file, KIND, VERSION).map_err(|e| Fault::new(format!("flow state: {e}")))
    }
}

fn grid(axes: &[SavedAxis]) -> Result<Grid, String> {
    let mut made = Vec::with_capacity(3);
    let mut ends = Vec::with_capacity(3);
    for a in axes {
        let [start, end] = a.core.map(|c| c as usize);
        let ascending = a.faces.windows(2).all(|f| f[0] < f[1]) && a.faces.iter().all(|x| x.is_finite());
        let fits = a.faces.len() == a.widths.len() + 1 && start < end && end <= a.widths.len();
        if !(ascending && fits && a.spacing > 0.0 && a.widths.len() > 1) {
            return Err("has an axis that is no grid".into());
        }
        made.push(Axis {
            faces: a.faces.clone(),
            widths: a.widths.clone(),
            core: start..end,
            spacing: a.spacing,
        });
        let end = |code: u8| match code {
            0 => Ok(End::Inflow),
            1 => Ok(End::Slip),
            2 => Ok(End::Outflow),
            other => Err(format!("has the condition {other} at an end")),
        };
        ends.push(Ends::Open([end(a.ends[0])?, end(a.ends[1])?]));
    }
    let axes = <[Axis; 3]>::try_from(made).map_err(|_| "has no three axes")?;
    let ends = <[Ends; 3]>::try_from(ends).map_err(|_| "has no three axes")?;
    Ok(Grid::new(axes, ends))
}
