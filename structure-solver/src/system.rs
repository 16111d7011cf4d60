//! The system level on one rank: mass, internal and external forces, tangent,
//! constraints, on the rows of owned nodes.

use comm::Comm;
use linalg::{BlockCsr, Cg, KrylovError, KrylovParams, Operator, Preconditioner};

use crate::elements::mass::MassMatrix;
use crate::flat::Block;
use crate::loops::{Configuration, ELSEWHERE, ElementLoop, FaceLoad};
use crate::model::Model;
use crate::stream::Stream;
use mesh::geometry::Vec3;

/// A block in a constrained row or column.
struct Masked {
    /// Owned node of the row.
    node: u32,
    slot: usize,
    row: [bool; 3],
    col: [bool; 3],
    diagonal: bool,
}

/// Equations of the owned nodes. Flat vectors have shape `[n_local][3]`.
pub struct System {
    /// Nodes and elements of this rank.
    pub model: Model,
    /// Tangent of the last [`System::tangent`].
    pub matrix: BlockCsr<3>,
    loops: Vec<Box<dyn ElementLoop>>,
    /// Mass of each block of the matrix, kg (the same in x, y and z).
    mass: Vec<f64>,
    masked: Vec<Masked>,
    fixed_owned: Vec<u32>,
    /// Some loop's forces depend on rates.
    rates: bool,
    /// Some loop's forces depend on time.
    timed: bool,
    /// Some loop's forces depend on the air.
    air: bool,
    /// Some loop's forces act between nodes that no element joins.
    pairs: bool,
    /// Some loop's pairs have friction.
    friction: bool,
    /// Displacements (m) that fixed components take in the next step; those not named
    /// stay. Local numbers `3 node + component`.
    pub(crate) prescribed: Vec<(u32, f64)>,
    /// Constant forces on components, N; local numbers as above.
    nodal: Vec<(u32, f64)>,
}

impl System {
    /// Lays out the matrix and finds each element's place in it.
    pub fn new(model: Model, mut loops: Vec<Box<dyn ElementLoop>>, kind: MassMatrix) -> Self {
        let nodes: Vec<Vec<u32>> = loops.iter().flat_map(|l| l.masses()).map(|(n, _)| n).collect();
        let matrix = BlockCsr::from_elements(model.halo.clone(), nodes.iter().map(Vec::as_slice));
        let n_owned = model.n_owned() as u32;
        let slot = |row: u32, col: u32| {
            if row < n_owned {
                matrix.slot(row as usize, col as usize).expect("elements made the pattern") as u32
            } else {
                ELSEWHERE
            }
        };
        let mut mass = vec![0.0; matrix.cols().len()];
        for element_loop in &mut loops {
            element_loop.assign_slots(&slot);
            for (element, (nodes, m)) in element_loop.masses().into_iter().enumerate() {
                let shares = element_loop.mass_shares(element, kind);
                let share = |i: usize, j: usize| shares[i * nodes.len() + j];
                for (i, &row) in nodes.iter().enumerate().filter(|(_, n)| **n < n_owned) {
                    for (j, &col) in nodes.iter().enumerate() {
                        mass[slot(row, col) as usize] += m * share(i, j);
                    }
                }
            }
        }
        for &(node, m) in model.point_masses.iter().filter(|(n, _)| *n < n_owned) {
            mass[matrix.diagonal_slot(node as usize)] += m;
        }
        let rates = loops.iter().any(|l| l.depends_on_rate());
        let timed = loops.iter().any(|l| l.depends_on_time());
        let air = loops.iter().any(|l| l.feels_air());
        let pairs = loops.iter().any(|l| l.has_history());
        let friction = loops.iter().any(|l| l.has_dissipation());
        let mut system = Self {
            model,
            matrix,
            loops,
            mass,
            masked: Vec::new(),
            fixed_owned: Vec::new(),
            rates,
            timed,
            air,
            pairs,
            friction,
            prescribed: Vec::new(),
            nodal: Vec::new(),
        };
        system.find_masked();
        system
    }

    /// Finds the blocks that the model's constraints change.
    fn find_masked(&mut self) {
        let Self { model, matrix, .. } = self;
        let components = |n: usize| [0, 1, 2].map(|c| model.fixed[3 * n + c]);
        self.masked.clear();
        for i in 0..model.n_owned() {
            for slot in matrix.row(i) {
                let j = matrix.cols()[slot] as usize;
                let (row, col) = (components(i), components(j));
                if row.contains(&true) || col.contains(&true) {
                    self.masked.push(Masked { node: i as u32, slot, row, col, diagonal: i == j });
                }
            }
        }
        let owned = 0..3 * model.n_owned() as u32;
        self.fixed_owned = owned.filter(|&i| model.fixed[i as usize]).collect();
    }

    /// Constrains components, local numbers `3 node + component`, in addition to those that
    /// the mesh constrains.
    pub fn fix(&mut self, dofs: &[u32]) {
        dofs.iter().for_each(|&i| self.model.fixed[i as usize] = true);
        self.find_masked();
    }

    /// Adds a constant force (N) on the mesh's node `node`.
    pub fn add_force(&mut self, node: u32, force: [f64; 3]) {
        if let Some(i) = self.model.numbering.local(u64::from(node)) {
            self.nodal.extend((0..3).map(|c| ((3 * i + c) as u32, force[c])));
        }
    }

    /// The element loops, for measures and pictures.
    pub fn loops(&self) -> &[Box<dyn ElementLoop>] {
        &self.loops
    }

    /// The same, to restore their saved states.
    pub(crate) fn loops_mut(&mut self) -> &mut [Box<dyn ElementLoop>] {
        &mut self.loops
    }

    /// See [`ElementLoop::anchor`].
    pub fn anchor(&mut self, x: &[f64]) {
        self.loops.iter_mut().for_each(|l| l.anchor(x));
    }

    /// Whether a step begins with [`System::set_step`] and [`System::anchor`] whatever
    /// the scheme.
    pub fn depends_on_rate(&self) -> bool {
        self.rates
    }

    /// See [`ElementLoop::set_step`].
    pub fn set_step(&mut self, dt: f64) {
        if self.rates {
            self.loops.iter_mut().for_each(|l| l.set_step(dt));
        }
    }

    /// Largest [`ElementLoop::retardation_time`], s.
    pub fn retardation_time(&self) -> f64 {
        self.loops.iter().map(|l| l.retardation_time()).fold(0.0, f64::max)
    }

    /// [`ElementLoop::anchor`] of the loops that depend on rates.
    pub fn anchor_rates(&mut self, x: &[f64]) {
        self.loops.iter_mut().filter(|l| l.depends_on_rate()).for_each(|l| l.anchor(x));
    }

    /// Whether a step begins with [`System::set_time`].
    pub fn depends_on_time(&self) -> bool {
        self.timed
    }

    /// See [`ElementLoop::set_time`].
    pub fn set_time(&mut self, t: f64) {
        if self.timed {
            self.loops.iter_mut().for_each(|l| l.set_time(t));
        }
    }

    /// Whether a window begins with [`System::set_air`].
    pub fn feels_air(&self) -> bool {
        self.air
    }

    /// See [`ElementLoop::set_air`].
    pub fn set_air(&mut self, air: &Stream) {
        if self.air {
            self.loops.iter_mut().for_each(|l| l.set_air(air));
        }
    }

    /// Whether a step begins with [`System::advance_history`].
    pub fn has_history(&self) -> bool {
        self.pairs
    }

    /// See [`ElementLoop::advance_history`].
    pub fn advance_history(&mut self, x: &[f64]) {
        if self.pairs {
            self.loops.iter_mut().for_each(|l| l.advance_history(x));
        }
    }

    /// Whether a step ends with [`System::advance_history`] and [`System::dissipated`].
    pub fn has_dissipation(&self) -> bool {
        self.friction
    }

    /// See [`ElementLoop::dissipated`]; of this rank.
    pub fn dissipated(&mut self) -> f64 {
        self.loops.iter_mut().map(|l| l.dissipated()).sum()
    }

    /// See [`ElementLoop::keep`].
    pub fn keep(&mut self) {
        self.loops.iter_mut().for_each(|l| l.keep());
    }

    /// See [`ElementLoop::rewind`].
    pub fn rewind(&mut self) {
        self.loops.iter_mut().for_each(|l| l.rewind());
    }

    /// See [`ElementLoop::air_force`]; of this rank.
    pub fn air_force(&self, x: &[f64]) -> Vec3 {
        self.loops.iter().fold(Vec3::zeros(), |sum, l| sum + l.air_force(x))
    }

    /// See [`ElementLoop::dissipation`]; of this rank.
    pub fn dissipation(&self, before: &[f64], after: &[f64]) -> f64 {
        self.loops.iter().map(|l| l.dissipation(before, after)).sum()
    }

    /// `out = R - F` on the owned rows: internal minus external forces, N.
    pub fn forces(&self, configuration: Configuration<'_>, load: FaceLoad<'_>, out: &mut [f64]) {
        out.fill(0.0);
        self.nodal.iter().for_each(|&(i, f)| out[i as usize] -= f);
        self.loops.iter().for_each(|l| l.forces(configuration, load, out));
    }

    /// Strain energy of the elements counted on this rank at positions `x` (m), J.
    pub fn energy(&self, x: &[f64]) -> f64 {
        self.loops.iter().map(|l| l.energy(x)).sum()
    }

    /// Tensions (N) of the cables of the model at positions `x` (m), in its order.
    pub fn tensions(&self, x: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.model.cables.len()];
        for l in &self.loops {
            for (&row, tension) in l.cables().iter().zip(l.tensions(x)) {
                all[row as usize] += tension;
            }
        }
        all
    }

    /// What loops say of the triangles of the model, in its order: of each the first that says anything, as `of` a loop in the order of
    /// [`ElementLoop::sheets`]; `none` of those of which no loop does.
    pub fn by_triangle<T: Clone>(&self, none: T, of: impl Fn(&dyn ElementLoop) -> Vec<T>) -> Vec<T> {
        let mut found: Vec<Option<T>> = vec![None; self.model.triangles.len()];
        for l in &self.loops {
            for (&row, value) in l.sheets().iter().zip(of(l.as_ref())) {
                found[row as usize].get_or_insert(value);
            }
        }
        found.into_iter().map(|f| f.unwrap_or_else(|| none.clone())).collect()
    }

    /// Work of the constant forces on owned nodes over the displacements `du` (m), J.
    pub fn nodal_work(&self, du: &[f64]) -> f64 {
        let owned = 3 * self.model.n_owned();
        self.nodal.iter().filter(|(i, _)| (*i as usize) < owned).map(|&(i, f)| f * du[i as usize]).sum()
    }

    /// `out = F`: external forces alone, N, with constrained components removed.
    pub fn external(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        self.pressed(x, load, out);
        self.nodal.iter().for_each(|&(i, f)| out[i as usize] += f);
    }

    /// `out`: nodal forces of the loads on faces alone, N.
    pub fn pressed(&self, x: &[f64], load: FaceLoad<'_>, out: &mut [f64]) {
        out.fill(0.0);
        self.loops.iter().for_each(|l| l.external(x, load, out));
    }

    /// As [`System::forces`]; the matrix becomes
    /// `stiffness_factor d(R - F)/dx + mass_factor M`, with constrained rows and
    /// columns replaced by their diagonal.
    pub fn tangent(
        &mut self,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        stiffness_factor: f64,
        mass_factor: f64,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        self.nodal.iter().for_each(|&(i, f)| out[i as usize] -= f);
        for (block, m) in self.matrix.values.iter_mut().zip(&self.mass) {
            *block = scaled_identity(mass_factor * m);
        }
        for l in &self.loops {
            l.tangent(configuration, load, stiffness_factor, out, &mut self.matrix.values);
        }
        self.mask(mass_factor, |_| true);
    }

    /// As [`System::tangent`] in the rows of `active` nodes, shape `[n_local]`, alone.
    pub fn tangent_near(
        &mut self,
        active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        stiffness_factor: f64,
        mass_factor: f64,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        self.nodal.iter().for_each(|&(i, f)| out[i as usize] -= f);
        for i in (0..self.model.n_owned()).filter(|&i| active[i]) {
            for slot in self.matrix.row(i) {
                self.matrix.values[slot] = scaled_identity(mass_factor * self.mass[slot]);
            }
        }
        for l in &self.loops {
            l.tangent_near(active, configuration, load, stiffness_factor, out, &mut self.matrix.values);
        }
        self.mask(mass_factor, |node| active[node as usize]);
    }

    fn mask(&mut self, mass_factor: f64, within: impl Fn(u32) -> bool) {
        for m in self.masked.iter().filter(|m| within(m.node)) {
            let block = &mut self.matrix.values[m.slot];
            for i in 0..3 {
                for j in 0..3 {
                    if m.row[i] || m.col[j] {
                        block[i][j] = 0.0;
                    }
                }
                if m.diagonal && m.row[i] {
                    // The inertia keeps the scale of its neighbours' diagonals.
                    let d = mass_factor * self.mass[m.slot];
                    block[i][i] = if d > 0.0 { d } else { 1.0 };
                }
            }
        }
    }

    /// `out = R - F + M w`, constrained, in the owned rows of `active` nodes, shape
    /// `[n_local]`; of no meaning in others.
    pub fn balance_near(
        &self,
        active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        w: &[f64],
        out: &mut [f64],
    ) {
        out.fill(0.0);
        self.nodal.iter().for_each(|&(i, f)| out[i as usize] -= f);
        self.loops.iter().for_each(|l| l.forces_near(active, configuration, load, out));
        self.add_mass_product_in(w, out, |i| active[i]);
        self.constrain(out);
    }

    /// `out += M w` on the owned rows. Ghosts of `w` are current.
    pub fn add_mass_product(&self, w: &[f64], out: &mut [f64]) {
        self.add_mass_product_in(w, out, |_| true);
    }

    #[inline]
    fn add_mass_product_in(&self, w: &[f64], out: &mut [f64], within: impl Fn(usize) -> bool) {
        let (w, out) = (w.as_chunks::<3>().0, out.as_chunks_mut::<3>().0);
        let (row_ptr, cols) = (self.matrix.row_ptr(), self.matrix.cols());
        for (i, y) in out[..self.model.n_owned()].iter_mut().enumerate().filter(|(i, _)| within(*i)) {
            let row = row_ptr[i]..row_ptr[i + 1];
            for (&j, m) in cols[row.clone()].iter().zip(&self.mass[row]) {
                let w = &w[j as usize];
                (0..3).for_each(|c| y[c] += m * w[c]);
            }
        }
    }

    /// Clears the constrained components of owned rows.
    pub fn constrain(&self, r: &mut [f64]) {
        self.fixed_owned.iter().for_each(|&i| r[i as usize] = 0.0);
    }

    /// Total mass of fabric, lines and points, kg.
    pub fn total_mass(&self) -> f64 {
        self.model.comm.sum(self.mass.iter().sum())
    }

    /// Mass that belongs to an owned node: the sum of its row, kg.
    pub fn lumped_mass(&self, node: usize) -> f64 {
        self.matrix.row(node).map(|slot| self.mass[slot]).sum()
    }

    /// Mass on the diagonal of an owned node, kg.
    pub fn diagonal_mass(&self, node: usize) -> f64 {
        self.mass[self.matrix.diagonal_slot(node)]
    }

    #[cfg(test)]
    pub(crate) fn mass_of_block(&self, node: usize) -> f64 {
        self.mass[self.matrix.diagonal_slot(node)]
    }

    /// Solves `M a = f` for the accelerations that start a motion. `f` is
    /// constrained; constrained components of `a` stay zero.
    pub fn accelerations(&self, f: &[f64], a: &mut [f64]) -> Result<(), KrylovError> {
        let n = 3 * self.model.n_owned();
        let operator = MassOperator(self);
        // The diagonal bounds a consistent mass matrix within a factor of four.
        let inverse = (0..n)
            .map(|i| match self.mass[self.matrix.diagonal_slot(i / 3)] {
                m if m > 0.0 && !self.model.fixed[i] => 1.0 / m,
                _ => 0.0,
            })
            .collect();
        let params = KrylovParams { rel_tol: 1e-10, max_iterations: 200, ..Default::default() };
        a.fill(0.0);
        Cg::new(&self.model.comm).solve(&operator, &Diagonal(inverse), f, a, params)?;
        self.model.halo.exchange(a, 3);
        Ok(())
    }

    /// The ranks of the program.
    pub fn comm(&self) -> &Comm {
        &self.model.comm
    }
}

fn scaled_identity(d: f64) -> Block {
    [[d, 0.0, 0.0], [0.0, d, 0.0], [0.0, 0.0, d]]
}

struct MassOperator<'a>(&'a System);

impl Operator for MassOperator<'_> {
    fn n_owned(&self) -> usize {
        3 * self.0.model.n_owned()
    }
    fn n_local(&self) -> usize {
        3 * self.0.model.n_local()
    }
    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        self.0.model.halo.exchange(x, 3);
        y[..self.n_owned()].fill(0.0);
        self.0.add_mass_product(x, y);
        self.0.constrain(y);
    }
}

struct Diagonal(Vec<f64>);

impl Preconditioner for Diagonal {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        for ((z, r), d) in z.iter_mut().zip(r).zip(&self.0) {
            *z = d * r;
        }
    }
}
