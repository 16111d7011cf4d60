//! Triangulated shapes for tests and examples.

use std::collections::HashMap;

use nalgebra::Vector3;

/// Nodes (m) and triangles.
pub type Surface = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

/// Sphere from an octahedron whose triangles are halved `level` times; normals point outwards.
pub fn sphere(radius: f64, level: u32) -> Surface {
    let mut nodes: Vec<Vector3<f64>> =
        (0..6).map(|i| Vector3::ith(i / 2, if i % 2 == 0 { 1.0 } else { -1.0 })).collect();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for (x, y, z) in [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    {
        faces.push([x, y, z]);
    }
    for _ in 0..level {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut finer = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let mut middle = |p: u32, q: u32| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    nodes.push((nodes[p as usize] + nodes[q as usize]).normalize());
                    nodes.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = finer;
    }
    nodes.iter_mut().for_each(|x| *x *= radius);
    (nodes, faces)
}

/// Square plate of side 1 with `n` by `n` squares, each of two triangles, with its normal along z.
pub fn plate(n: usize) -> Surface {
    mapped(n, n, |s, t| Vector3::new(s - 0.5, t - 0.5, 0.0))
}

/// Disk of diameter 1 with `n` rings, with its normal along z.
pub fn disk(n: usize) -> Surface {
    round(n, |r, c, s| Vector3::new(0.5 * r * c, 0.5 * r * s, 0.0))
}

/// Hemisphere of diameter 1 with `n` rings, its pole at z = 0.5 and its rim at z = 0, with normals outwards.
pub fn hemisphere(n: usize) -> Surface {
    round(n, |r, c, s| {
        let (sin, cos) = (0.5 * std::f64::consts::PI * r).sin_cos();
        0.5 * Vector3::new(sin * c, sin * s, cos)
    })
}

/// Circular cylinder without ends, `n` triangles of each kind around, its axis along y from -`half` to `half`; normals point outwards.
pub fn cylinder(radius: f64, n: usize, half: f64) -> Surface {
    mapped(n, 1, |s, t| {
        let (sin, cos) = (std::f64::consts::TAU * s).sin_cos();
        Vector3::new(radius * sin, half * (2.0 * t - 1.0), radius * cos)
    })
}

fn mapped(n: usize, m: usize, at: impl Fn(f64, f64) -> Vector3<f64>) -> Surface {
    let node = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let nodes = (0..=m).flat_map(|j| (0..=n).map(move |i| (i, j)));
    let nodes = nodes.map(|(i, j)| at(i as f64 / n as f64, j as f64 / m as f64)).collect();
    let squares = (0..m).flat_map(|j| (0..n).map(move |i| (i, j)));
    let faces = squares
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    (nodes, faces)
}

/// Rings around a pole, ring i of 6 i nodes; `at` of the ring's share of the way to the rim, cosine and sine of the angle.
fn round(n: usize, at: impl Fn(f64, f64, f64) -> Vector3<f64>) -> Surface {
    let mut nodes = vec![at(0.0, 1.0, 0.0)];
    let start = |ring: usize| if ring == 0 { 0 } else { 1 + 3 * ring * (ring - 1) };
    for ring in 1..=n {
        for k in 0..6 * ring {
            let (s, c) = (std::f64::consts::TAU * k as f64 / (6 * ring) as f64).sin_cos();
            nodes.push(at(ring as f64 / n as f64, c, s));
        }
    }
    let node = |ring: usize, k: usize| (start(ring) + if ring == 0 { 0 } else { k % (6 * ring) }) as u32;
    let mut faces = Vec::new();
    for ring in 1..=n {
        for sector in 0..6 {
            for k in 0..ring {
                let (outer, inner) = (sector * ring + k, sector * (ring - 1) + k);
                faces.push([node(ring, outer), node(ring, outer + 1), node(ring - 1, inner)]);
                if k + 1 < ring {
                    faces.push([node(ring, outer + 1), node(ring - 1, inner + 1), node(ring - 1, inner)]);
                }
            }
        }
    }
    (nodes, faces)
}
