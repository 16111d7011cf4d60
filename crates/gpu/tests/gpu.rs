//! Steps on a GPU are those of the processor. The tests of its kernels without a GPU are those of the crate `immersed` (`--test device`).

use std::rc::Rc;

use immersed::shapes;
use immersed::slabs::Alone;

#[path = "../../immersed/tests/scenarios/mod.rs"]
mod scenarios;

use scenarios::{cases, compare_all, run, windows};

#[test]
#[ignore = "needs a GPU"]
fn a_gpu_computes_the_same_flow() {
    let device = gpu::open().expect("a GPU");
    println!("{}", device.name());
    for (name, (nodes, faces), low, model) in cases() {
        println!("{name}, {low:?}, {model:?}:");
        let one = run(Rc::new(Alone), None, &nodes, &faces, low, model);
        let other = run(Rc::new(Alone), Some(device.clone()), &nodes, &faces, low, model);
        compare_all(&one, &other);
    }
    // A run repeats bit by bit, also where windows are solved repeatedly.
    let (nodes, faces) = shapes::sphere(0.45, 2);
    let [once, repeated] =
        [false, true].map(|repeated| windows(Rc::new(Alone), Some(device.clone()), &nodes, &faces, repeated));
    assert!(once.iter().zip(&repeated).all(|(a, b)| a.to_bits() == b.to_bits()));
}

/// Where a library or the GPU is missing, its name and what to do about it are in the words; where none is, the test above says more.
#[test]
fn what_is_missing_is_named() {
    if let Err(error) = gpu::open() {
        let words = error.to_string();
        assert!(words.contains("LD_LIBRARY_PATH") || words.contains("no GPU"), "{words}");
    }
}
