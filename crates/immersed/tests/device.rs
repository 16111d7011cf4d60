//! Steps on a device are those of this processor. A C compiler builds the kernels of the device for this processor, and a test runs them one thread after the
//! other: what they compute is tested without a GPU, its library and its threads are not.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::process::Command;
use std::rc::Rc;
use std::sync::OnceLock;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use immersed::axis::Axis;
use immersed::device::{Address, Device, DeviceError, KERNEL_NAMES, KERNELS, NoDevice, Product};
use immersed::flow::{Flow, Settings};
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use immersed::slabs::Alone;
use libloading::{Library, Symbol};
use nalgebra::Vector3;
use tempfile::TempDir;

use scenarios::{cases, compare, compare_all, run, windows};

mod scenarios;

type Loop = unsafe extern "C" fn(*const u64, i64, i64) -> i32;

/// A folder with the kernels as a library.
fn built(text: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let [source, library] = ["kernels.c", "kernels.so"].map(|name| folder.path().join(name));
    std::fs::write(&source, text).expect("written");
    let mut compiler = Command::new("cc");
    compiler.args(["-x", "c", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o"]);
    let done = compiler.arg(&library).arg(&source).arg("-lm").status().expect("a C compiler");
    assert!(done.success());
    folder
}

/// The kernels of a device on this processor.
#[derive(Debug)]
struct Emulated {
    library: Library,
    memory: RefCell<HashMap<Address, Vec<u64>>>,
    /// Words that it has at most, and how often it was called.
    most: usize,
    calls: Cell<usize>,
}

impl Emulated {
    /// With this many words of memory; `change`: replaces a part of the source.
    fn with(most: usize, change: Option<[&str; 2]>) -> Rc<Self> {
        static UNCHANGED: OnceLock<TempDir> = OnceLock::new();
        let own = change.map(|[from, to]| {
            assert!(KERNELS.contains(from), "{from}");
            built(&KERNELS.replacen(from, to, 1))
        });
        let folder = own.as_ref().unwrap_or_else(|| UNCHANGED.get_or_init(|| built(KERNELS)));
        // SAFETY: the library has no initialisers.
        let library =
            unsafe { Library::new(folder.path().join("kernels.so")) }.expect("the library just built");
        Rc::new(Self { library, memory: RefCell::default(), most, calls: Cell::new(0) })
    }

    fn failure(what: &str) -> DeviceError {
        DeviceError { device: "emulated".into(), what: what.into() }
    }

    /// Checks that `words` words from an address are in one allocation.
    fn check(&self, at: Address, words: usize) {
        self.calls.set(self.calls.get() + 1);
        let end = at + 8 * words as u64;
        let memory = self.memory.borrow();
        assert!(
            memory.iter().any(|(start, own)| *start <= at && end <= start + 8 * own.len() as u64),
            "{words} words at {at:x}"
        );
    }
}

impl Device for Emulated {
    fn name(&self) -> String {
        "emulated".into()
    }

    fn allocate(&self, words: usize) -> Result<Address, DeviceError> {
        let mut memory = self.memory.borrow_mut();
        if memory.values().map(Vec::len).sum::<usize>() + words > self.most {
            return Err(Self::failure("out of memory"));
        }
        let own = vec![0; words];
        let address = own.as_ptr() as Address;
        memory.insert(address, own);
        Ok(address)
    }

    fn free(&self, address: Address, words: usize) {
        let freed = self.memory.borrow_mut().remove(&address).expect("allocated");
        assert_eq!(freed.len(), words);
    }

    fn upload(&self, to: Address, values: &[f64]) -> Result<(), DeviceError> {
        self.check(to, values.len());
        // SAFETY: the words were just found in one allocation.
        unsafe { std::slice::from_raw_parts_mut(to as *mut f64, values.len()) }.copy_from_slice(values);
        Ok(())
    }

    fn upload_indices(&self, to: Address, values: &[u32]) -> Result<(), DeviceError> {
        self.check(to, values.len().div_ceil(2));
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts_mut(to as *mut u32, values.len()) }.copy_from_slice(values);
        Ok(())
    }

    fn download(&self, from: Address, values: &mut [f64]) -> Result<(), DeviceError> {
        self.check(from, values.len());
        // SAFETY: as above.
        values.copy_from_slice(unsafe { std::slice::from_raw_parts(from as *const f64, values.len()) });
        Ok(())
    }

    fn copy(&self, from: Address, to: Address, words: usize) -> Result<(), DeviceError> {
        let mut values = vec![0.0; words];
        self.download(from, &mut values)?;
        self.upload(to, &values)
    }

    fn clear(&self, at: Address, words: usize) -> Result<(), DeviceError> {
        self.upload(at, &vec![0.0; words])
    }

    fn launch(&self, kernel: &'static str, threads: usize, arguments: &[u64]) -> Result<(), DeviceError> {
        assert!(KERNEL_NAMES.contains(&kernel));
        // A GPU starts whole blocks.
        let threads = threads.next_multiple_of(256);
        // SAFETY: the kernel has this signature, and checks the number of words.
        let wrong = unsafe {
            let run: Symbol<'_, Loop> = self.library.get(kernel.as_bytes()).expect("the kernel");
            run(arguments.as_ptr(), arguments.len() as i64, threads as i64)
        };
        assert_eq!(wrong, 0, "{kernel} has other arguments than {}", arguments.len());
        Ok(())
    }

    fn multiply(&self, p: &Product) -> Result<(), DeviceError> {
        let [rows, columns, length] = p.size;
        let of = |i: usize, index: usize, [rows, columns]: [usize; 2]| {
            let at = p.at[i] + 8 * (p.next[i] * index) as u64;
            self.check(at, p.columns[i] * (columns - 1) + rows);
            (at, rows, columns, p.columns[i] as isize)
        };
        let stored = |transposed: bool, [a, b]: [usize; 2]| if transposed { [b, a] } else { [a, b] };
        for index in 0..p.count {
            let a = of(0, index, stored(p.transposed[0], [rows, length]));
            let b = of(1, index, stored(p.transposed[1], [length, columns]));
            let c = of(2, index, [rows, columns]);
            // SAFETY: the matrices were just found in allocations, and C is none of the others.
            unsafe {
                let matrix = |m: (Address, usize, usize, isize)| {
                    MatRef::from_raw_parts(m.0 as *const f64, m.1, m.2, 1, m.3)
                };
                let [a, b] = [(a, p.transposed[0]), (b, p.transposed[1])]
                    .map(|(m, t)| if t { matrix(m).transpose() } else { matrix(m) });
                let out = MatMut::from_raw_parts_mut(c.0 as *mut f64, c.1, c.2, 1, c.3);
                matmul(out, Accum::Replace, a, b, 1.0, Par::Seq);
            }
        }
        Ok(())
    }
}

const ENOUGH: usize = 1 << 28;

#[test]
fn a_device_computes_the_same_flow() {
    for (name, (nodes, faces), low, model) in cases() {
        println!("{name}, {low:?}, {model:?}:");
        let device = Emulated::with(ENOUGH, None);
        let one = run(Rc::new(Alone), None, &nodes, &faces, low, model);
        let other = run(Rc::new(Alone), Some(device.clone()), &nodes, &faces, low, model);
        assert!(device.calls.get() > 1000);
        compare_all(&one, &other);
        assert!(device.memory.borrow().is_empty(), "all memory is freed with the flow");
    }
}

/// Windows of several steps that are solved repeatedly and rejected.
#[test]
fn repeated_windows_on_a_device_change_no_digit() {
    let (nodes, faces) = shapes::sphere(0.45, 2);
    let on_host = windows(Rc::new(Alone), None, &nodes, &faces, true);
    let [once, repeated] = [false, true].map(|repeated| {
        windows(Rc::new(Alone), Some(Emulated::with(ENOUGH, None)), &nodes, &faces, repeated)
    });
    assert!(once.iter().zip(&repeated).all(|(a, b)| a.to_bits() == b.to_bits()));
    // The constraints are solved to 1e-6.
    let size = on_host.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let error = on_host.iter().zip(&once).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
    assert!(on_host.len() == once.len() && error < 1e-5 * size, "{error:e} of {size:e}");
}

fn flow() -> Flow {
    let axis = || Axis::stretched([-0.5, 0.5], 0.1, [1.0, 1.0], 1.3, 2);
    let open = Ends::Open([End::Inflow, End::Outflow]);
    let grid = Grid::new([axis(), axis(), axis()], [open; 3]);
    let momentum = Momentum { upwind_share: 1.0, viscosity: 0.01 };
    let far = Vector3::new(0.2, 0.1, 1.0);
    Flow::new(grid, Settings { density: 1.0, far, momentum, tolerance: 1e-6 })
}

/// Undisturbed air whose velocity changes with height, on a grid that moves.
#[test]
fn a_shear_flow_on_a_device_is_that_of_this_processor() {
    let end = |device: Option<Rc<dyn Device>>| {
        let mut flow = flow();
        flow.set_device(device).expect("memory");
        let wind = |z: f64| Vector3::new(0.3 * z, -0.1 * z * z, 1.0);
        flow.set_far_by_height(wind, wind);
        flow.start_undisturbed();
        flow.perturb(0.2);
        for step in 0..4 {
            let at = |time: f64| move |z: f64| wind(z + 0.2 * time);
            flow.set_far_by_height(at(0.02 * f64::from(step)), at(0.02 * f64::from(step + 1)));
            flow.predict(0.02, Vector3::new(0.0, 0.0, 0.2));
            flow.accept(&immersed::constraints::FluxConstraints::new(&flow.grid), &Default::default());
        }
        flow.gather();
        flow.state().velocity.concat()
    };
    compare("velocity", &end(None), &end(Some(Emulated::with(ENOUGH, None))));
}

/// Air that returns through outflows, on all sides.
#[test]
fn air_returns_through_an_outflow_on_a_device_as_on_this_processor() {
    let end = |device: Option<Rc<dyn Device>>| {
        let axis = || Axis::even(0.0, 1.0, 12);
        let out = Ends::Open([End::Outflow; 2]);
        let momentum = Momentum { upwind_share: 0.5, viscosity: 0.01 };
        let settings = Settings { density: 1.0, far: Vector3::zeros(), momentum, tolerance: 1e-6 };
        let mut flow = Flow::new(Grid::new([axis(), axis(), axis()], [out; 3]), settings);
        flow.set_device(device).expect("memory");
        flow.set_velocity(|x| Vector3::new((7.0 * x.y).sin(), (9.0 * x.z).cos(), (8.0 * x.x).sin()));
        for _ in 0..4 {
            flow.predict(0.02, Vector3::new(0.1, -0.05, 0.02));
            flow.accept(&immersed::constraints::FluxConstraints::new(&flow.grid), &Default::default());
        }
        flow.gather();
        flow.state().velocity.concat()
    };
    compare("velocity", &end(None), &end(Some(Emulated::with(ENOUGH, None))));
    // Without the limit on the momentum that enters the flow is another one.
    let change = ["if (m == 1 && a->low[d]) v = MATH(fmin)(v, 0.0);", ""];
    let without = end(Some(Emulated::with(ENOUGH, Some(change))));
    assert!(end(None).iter().zip(&without).any(|(a, b)| (a - b).abs() > 1e-4));
}

#[test]
fn a_device_without_memory_is_named() {
    let count = flow().grid.array_len();
    let mut flow = flow();
    let refused = flow.set_device(Some(Emulated::with(10 * count, None))).expect_err("too small");
    assert!(
        matches!(&refused, NoDevice::Failed(e) if e.to_string() == "emulated: out of memory"),
        "{refused}"
    );
    assert!(flow.device().is_none());
    // With just enough for the arrays later allocations fail, and what follows is not a number.
    let fits = (11..200).find(|share| flow.set_device(Some(Emulated::with(share * count, None))).is_ok());
    assert!(fits.is_some_and(|share| share > 12), "{fits:?}");
    flow.predict(0.01, Vector3::zeros());
    let rows = immersed::constraints::FluxConstraints::new(&flow.grid);
    flow.accept_and_keep(&rows, &Default::default());
    assert_eq!(flow.device_failure(), Some(Emulated::failure("out of memory")));
    assert!(flow.largest_speed(Vector3::zeros()).is_nan());
}

/// Faults in the kernels are found.
#[test]
fn a_wrong_loop_changes_the_flow() {
    let (_, (nodes, faces), low, model) = cases().into_iter().nth(3).expect("the plate with eddies");
    let one = run(Rc::new(Alone), None, &nodes, &faces, low, model);
    for fault in [
        ["3.0 * (c - b)) - k", "3.03 * (c - b)) - k"],
        ["a.rates[c][at] -= a.factor * sum", "a.rates[c][at] += a.factor * sum"],
        ["sum += a.factor[e] *", "sum -= a.factor[e] *"],
        ["normal ? n : n - 1;", "normal ? n : n - 2;"],
        ["z += a.factor / a.distance[s];", "z += 1.01 * a.factor / a.distance[s];"],
        ["a.dt * a.rate[thread]", "0.9 * a.dt * a.rate[thread]"],
        ["- gradient) / a.dt", "+ gradient) / a.dt"],
        ["first += a.factor", "first += 1.01 * a.factor"],
        ["a.u[d][upper - across] + a.u[d][upper]", "a.u[d][upper - across]"],
        ["0.25 * ((v[p]", "0.2525 * ((v[p]"],
        ["a.leak[thread] * a.jump[thread]", "1.01 * a.leak[thread] * a.jump[thread]"],
    ] {
        let other =
            run(Rc::new(Alone), Some(Emulated::with(ENOUGH, Some(fault))), &nodes, &faces, low, model);
        let differ =
            one.velocity.iter().zip(&other.velocity).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        assert!(differ > 1e-7, "{fault:?}: {differ:e}");
    }
}
