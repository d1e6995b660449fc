//! Remeshed and repaired meshes.

use glam::DVec3;
use proptest::prelude::*;

use crate::meshing::samples::{ball, body, roughened, torus, torus_field};
use crate::meshing::{
    RemeshOptions, RepairOptions, Sizing, TriangleMesh, closest_points, remesh, renew, repair,
};

/// The largest distance of a mesh's vertices and the middles of its faces to another mesh.
fn farthest(mesh: &TriangleMesh, other: &TriangleMesh) -> f64 {
    let middle = |f: &[u32; 3]| {
        f.map(|v| DVec3::from(mesh.positions[v as usize]))
            .iter()
            .sum::<DVec3>()
            / 3.0
    };
    let middles = mesh.faces.iter().map(|f| middle(f).to_array());
    let points: Vec<[f64; 3]> = mesh.positions.iter().copied().chain(middles).collect();
    let found = closest_points(other, &points).expect("points");
    let distance = |(on, p): (crate::meshing::SurfacePoint, &[f64; 3])| {
        DVec3::from(on.interpolate(&other.faces, &other.positions)).distance(DVec3::from(*p))
    };
    found
        .into_iter()
        .zip(&points)
        .map(distance)
        .fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// A remeshed torus stays a torus near the old one, its edges are even, and values of vertices come along.
    #[test]
    fn remeshing_keeps_the_surface(cells in 24u32..48, tube in 0.25..0.45f64, length in 0.08..0.16f64) {
        let mesh = torus(cells, tube);
        let found = remesh(&mesh, &RemeshOptions::uniform(length)).expect("a mesh");
        let all = found.mesh.statistics().expect("a mesh");
        prop_assert!(all.is_solid() && all.genus == Some(1) && all.crossings == 0, "{all:?}");
        prop_assert!(all.folds == 0 && all.even_edges > 0.97, "{all:?}");
        prop_assert!((all.median_edge / length - 1.0).abs() < 0.15, "{all:?}");
        prop_assert!(farthest(&found.mesh, &mesh) < 0.3 * length);
        prop_assert!(farthest(&mesh, &found.mesh) < 0.3 * length);
        for (on, p) in found.from.iter().zip(&found.mesh.positions) {
            let q = on.interpolate(&mesh.faces, &mesh.positions);
            prop_assert!(DVec3::from(q).distance(DVec3::from(*p)) < 1e-9);
        }
    }

    /// Rough surfaces with folds and crossings become sound.
    #[test]
    fn rough_meshes_are_repaired(cells in 16u32..32, size in 0.02..0.3f64) {
        let rough = roughened(&ball(cells), size);
        let found = repair(&rough, &RepairOptions::default()).expect("a mesh");
        let all = found.mesh.statistics().expect("a mesh");
        prop_assert!(all.is_solid() && all.crossings == 0 && all.volume > 0.0, "{all:?}");
        let all = renew(&rough, 0.15).expect("a mesh").statistics().expect("a mesh");
        prop_assert!(all.is_solid() && all.crossings == 0 && all.folds == 0, "{all:?}");
        prop_assert!(all.even_edges > 0.95, "{all:?}");
    }
}

#[test]
fn thin_parts_keep_their_sides() {
    // A plate of the thickness 0.08 with a rod, and edges of 0.07.
    let field = |p: DVec3| {
        let plate = (1.0 - p.truncate().length()).min(0.04 - p.z.abs());
        let rod = (0.06 - p.truncate().length()).min(1.2 - p.z.abs());
        plate.max(rod)
    };
    let mesh = body(80, field);
    let even = remesh(&mesh, &RemeshOptions::uniform(0.07))
        .expect("a mesh")
        .mesh;
    let (was, is) = (
        mesh.statistics().expect("a mesh"),
        even.statistics().expect("a mesh"),
    );
    assert!(
        is.is_solid() && is.genus == was.genus && is.components == 1,
        "{is:?}"
    );
    assert!(is.even_edges > 0.95, "{is:?}");
    assert!((is.volume / was.volume - 1.0).abs() < 0.1, "{is:?}");
    let sound = repair(&even, &RepairOptions::default())
        .expect("a mesh")
        .mesh;
    let found = sound.statistics().expect("a mesh");
    assert!(
        found.is_solid() && found.crossings == 0 && found.genus == Some(0),
        "{found:?}"
    );
}

#[test]
fn lengths_differ_from_place_to_place() {
    let mesh = ball(32);
    let lengths: Vec<f64> = mesh.positions.iter().map(|p| 0.11 + 0.06 * p[2]).collect();
    let graded = remesh(
        &mesh,
        &RemeshOptions::with_sizing(Sizing::PerVertex(lengths)),
    )
    .expect("a mesh");
    let count = |up: bool| {
        graded
            .mesh
            .positions
            .iter()
            .filter(|p| (p[2] > 0.0) == up)
            .count()
    };
    assert!(
        count(false) > 3 * count(true) / 2,
        "{} {}",
        count(false),
        count(true)
    );
    let found = graded.mesh.statistics().expect("a mesh");
    assert!(found.is_solid() && found.genus == Some(0), "{found:?}");
    // A capsule has more curvature at its ends.
    let capsule = body(40, |p| 0.3 - p.distance(DVec3::Z * p.z.clamp(-0.9, 0.9)));
    let sizing = Sizing::Curvature {
        error: 0.01,
        shortest: 0.05,
        longest: 0.3,
    };
    let found = remesh(&capsule, &RemeshOptions::with_sizing(sizing)).expect("a mesh");
    assert!(farthest(&found.mesh, &capsule) < 0.03);
}

#[test]
fn open_meshes_keep_their_border() {
    let side = 12u32;
    let positions =
        (0..side * side).map(|i| [f64::from(i % side) / 11.0, f64::from(i / side) / 11.0, 0.0]);
    let faces = (0..(side - 1) * (side - 1)).flat_map(|i| {
        let a = i / (side - 1) * side + i % (side - 1);
        [[a, a + 1, a + side], [a + 1, a + side + 1, a + side]]
    });
    let mesh = TriangleMesh::new(positions.collect(), faces.collect()).expect("a mesh");
    for length in [0.03, 0.2] {
        let found = remesh(&mesh, &RemeshOptions::uniform(length))
            .expect("a mesh")
            .mesh;
        assert!((found.area() - 1.0).abs() < 1e-9, "{}", found.area());
        let all = found.statistics().expect("a mesh");
        assert!(all.edge_manifold && all.oriented && !all.closed && all.euler_characteristic == 1);
    }
}

#[test]
fn small_and_bad_meshes_are_no_trouble() {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let solid = TriangleMesh::new(corners.clone(), faces).expect("a mesh");
    for length in [0.1, 1.0, 100.0] {
        let found = remesh(&solid, &RemeshOptions::uniform(length))
            .expect("a mesh")
            .mesh;
        let all = found.statistics().expect("a mesh");
        assert!(all.is_solid() && all.genus == Some(0), "{all:?}");
    }
    // A cone whose tip has many faces.
    let count = 5000;
    let rim = |i: u32| {
        let angle = f64::from(i) / f64::from(count) * std::f64::consts::TAU;
        [angle.cos(), angle.sin(), 0.0]
    };
    let positions = [[0.0, 0.0, 1.0], [0.0; 3]]
        .into_iter()
        .chain((0..count).map(rim));
    let sides = (0..count).flat_map(|i| {
        let (a, b) = (2 + i, 2 + (i + 1) % count);
        [[0, a, b], [1, b, a]]
    });
    let cone = TriangleMesh::new(positions.collect(), sides.collect()).expect("a mesh");
    let found = remesh(&cone, &RemeshOptions::uniform(0.1))
        .expect("a mesh")
        .mesh;
    let all = found.statistics().expect("a mesh");
    assert!(all.is_solid() && all.genus == Some(0), "{all:?}");
    assert!(found.faces.len() < 2500, "{}", found.faces.len());
    let nothing = TriangleMesh::default();
    assert!(
        remesh(&nothing, &RemeshOptions::uniform(1.0))
            .expect("a mesh")
            .from
            .is_empty()
    );
    // Faces without area, several at an edge, and the same face twice.
    let faces = vec![[0, 1, 2], [0, 1, 2], [0, 1, 3], [2, 1, 0], [1, 2, 3]];
    let flat = vec![[0.5; 3]; 4];
    for positions in [corners, flat] {
        let mesh = TriangleMesh::new(positions, faces.clone()).expect("a mesh");
        for length in [0.2, 5.0] {
            remesh(&mesh, &RemeshOptions::uniform(length)).expect("a mesh");
        }
        let _ = repair(&mesh, &RepairOptions::default());
    }
}

#[test]
fn bad_options_are_errors() {
    let mesh = ball(8);
    let fails = |options: RemeshOptions, wanted: &str| {
        let error = remesh(&mesh, &options).expect_err("an error").to_string();
        assert!(error.contains(wanted), "{error}");
    };
    fails(RemeshOptions::uniform(f64::NAN), "sizing is NaN");
    fails(RemeshOptions::uniform(1e-9), "at most 20000000 faces");
    fails(
        RemeshOptions::with_sizing(Sizing::PerVertex(vec![1.0])),
        "1 lengths",
    );
    let error = repair(&TriangleMesh::default(), &RepairOptions::default()).expect_err("an error");
    assert!(error.to_string().contains("enclose"), "{error}");
    let error =
        repair(&mesh, &RepairOptions::default().with_edge_length(-1.0)).expect_err("an error");
    assert!(error.to_string().contains("edge_length is -1"), "{error}");
}

#[test]
fn vertices_that_were_pushed_in_come_out() {
    let mut mesh = ball(24);
    let whole = mesh.volume();
    for (k, p) in mesh.positions.iter_mut().enumerate() {
        if k % 97 == 0 {
            *p = p.map(|x| -0.3 * x);
        }
    }
    let before = mesh.statistics().expect("a mesh");
    assert!(before.folds > 0 && before.crossings > 0);
    let found = repair(&mesh, &RepairOptions::default()).expect("a mesh");
    let after = found.mesh.statistics().expect("a mesh");
    assert!(
        after.is_solid() && after.crossings == 0 && after.genus == Some(0),
        "{after:?}"
    );
    assert!((after.volume / whole - 1.0).abs() < 0.1, "{after:?}");
}

#[test]
fn bulges_that_pass_through_each_other_become_one() {
    // A horseshoe whose ends were pushed into each other.
    let mesh = body(64, |p| {
        let angle = p.y.atan2(p.x).clamp(-2.6, 2.6);
        0.3 - p.distance(DVec3::new(angle.cos(), angle.sin(), 0.0))
    });
    let mut mesh = remesh(&mesh, &RemeshOptions::uniform(0.09))
        .expect("a mesh")
        .mesh;
    assert_eq!(mesh.statistics().expect("a mesh").crossings, 0);
    for p in &mut mesh.positions {
        let (angle, r) = (p[1].atan2(p[0]) * 1.2, p[0].hypot(p[1]));
        (p[0], p[1]) = (r * angle.cos(), r * angle.sin());
    }
    let before = mesh.statistics().expect("a mesh");
    assert!(
        before.crossings > 10 && before.genus == Some(0),
        "{before:?}"
    );
    let found = repair(&mesh, &RepairOptions::default().with_rounds(2)).expect("a mesh");
    let after = found.mesh.statistics().expect("a mesh");
    assert!(found.rebuilt, "{after:?}");
    assert!(
        after.is_solid() && after.crossings == 0 && after.genus == Some(1),
        "{after:?}"
    );
    assert!(after.even_edges > 0.95, "{after:?}");
    assert!(farthest(&found.mesh, &mesh) < 0.09);
}

#[test]
fn holes_are_closed() {
    let mut mesh = body(40, |p| torus_field(p, 0.35));
    mesh.faces.drain(100..140);
    let found = repair(&mesh, &RepairOptions::default()).expect("a mesh");
    let after = found.mesh.statistics().expect("a mesh");
    assert!(found.rebuilt && after.is_solid() && after.genus == Some(1) && after.crossings == 0);
}

/// The largest angle between the normals of a face and of one of its vertices, in degrees.
fn bend(mesh: &TriangleMesh) -> f64 {
    let normals = mesh.vertex_normals();
    let off = (0..mesh.faces.len() as u32).flat_map(|f| {
        let normal = mesh.area_vector(f).normalize();
        let at = mesh.faces[f as usize];
        at.map(|v| normal.angle_between(normals[v as usize].normalize()))
    });
    off.fold(0.0, f64::max).to_degrees()
}

/// A finer mesh of a ball has no facets of the coarse one, whose shape it keeps, and a mesh that does not become finer keeps
/// its details.
#[test]
fn finer_meshes_have_no_facets() {
    let coarse = remesh(&ball(32), &RemeshOptions::uniform(0.4))
        .expect("a mesh")
        .mesh;
    let (fine, facets) = (
        renew(&coarse, 0.13).expect("a mesh"),
        remesh(&coarse, &RemeshOptions::uniform(0.13))
            .expect("a mesh")
            .mesh,
    );
    let (found, flat) = (bend(&fine), bend(&facets));
    assert!(found < 0.6 * flat, "{found}° of {flat}°");
    assert!((fine.volume() / coarse.volume() - 1.0).abs() < 0.01);
    let all = fine.statistics().expect("a mesh");
    assert!(
        all.is_solid() && all.crossings == 0 && all.even_edges > 0.95,
        "{all:?}"
    );
    let rough = roughened(&fine, 0.02);
    let again = renew(&rough, 0.13).expect("a mesh");
    assert!(
        bend(&again) > 0.7 * bend(&rough),
        "{} {}",
        bend(&again),
        bend(&rough)
    );
}
