//! Meshes for tests.

use std::collections::HashMap;
use std::f64::consts::TAU;

/// Positions and faces.
pub type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A sphere of radius 1 with 8 · 4^levels faces.
pub fn ball(levels: usize) -> Mesh {
    let mut positions: Vec<[f64; 3]> = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut p = [0.0; 3];
            p[axis] = sign;
            positions.push(p);
        }
    }
    let mut faces = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    for _ in 0..levels {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let (p, q) = (positions[a as usize], positions[b as usize]);
                let sum = [p[0] + q[0], p[1] + q[1], p[2] + q[2]];
                let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
                positions.push(sum.map(|x| x / length));
                positions.len() as u32 - 1
            })
        };
        let split = |&[a, b, c]: &[u32; 3]| {
            let [d, e, f] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        };
        faces = faces.iter().flat_map(split).collect();
    }
    (positions, faces)
}

/// A ball whose vertices are moved along their radii by up to `noise`.
pub fn noisy_ball(levels: usize, noise: f64) -> Mesh {
    let (mut positions, faces) = ball(levels);
    let mut state = 1u64;
    for p in &mut positions {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let random = (state >> 40) as f64 / (1u64 << 23) as f64 - 1.0;
        *p = p.map(|x| x * (1.0 + noise * random));
    }
    (positions, faces)
}

/// A torus of `around` × `across` quads with bumps of the given height.
pub fn torus(around: u32, across: u32, bumps: f64) -> Mesh {
    let mut positions = Vec::new();
    for i in 0..around {
        for j in 0..across {
            let (a, b) = (
                TAU * f64::from(i) / f64::from(around),
                TAU * f64::from(j) / f64::from(across),
            );
            let small = 0.4 + bumps * (5.0 * a).sin() * (3.0 * b + a).cos();
            let large = 1.0 + small * b.cos();
            positions.push([large * a.cos(), large * a.sin(), small * b.sin()]);
        }
    }
    let at = |i: u32, j: u32| (i % around) * across + j % across;
    let mut faces = Vec::new();
    for i in 0..around {
        for j in 0..across {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    (positions, faces)
}

/// A cube with n² · 12 faces, whose sides share no vertices.
pub fn cube(n: u32) -> Mesh {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let first = positions.len() as u32;
            for i in 0..=n {
                for j in 0..=n {
                    let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    let mut p = [0.0; 3];
                    p[axis] = sign;
                    p[(axis + 1) % 3] = sign * (2.0 * u - 1.0);
                    p[(axis + 2) % 3] = 2.0 * v - 1.0;
                    positions.push(p);
                }
            }
            let at = |i: u32, j: u32| first + i * (n + 1) + j;
            for i in 0..n {
                for j in 0..n {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    faces.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    (positions, faces)
}
