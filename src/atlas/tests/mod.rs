//! Tests of atlases.

mod meshes;
mod properties;

use glam::{DVec2, DVec3};
use meshes::{Mesh, ball, cube, noisy_ball, torus};

use super::overlap::any_cross;
use super::*;

/// An atlas with the default options.
fn atlas_of(mesh: &Mesh, size: usize) -> Atlas {
    Atlas::new(&mesh.0, &mesh.1, size, &AtlasOptions::default()).expect("an atlas")
}

/// The triangles of an atlas in texture space.
fn flat_triangles(atlas: &Atlas) -> Vec<[DVec2; 3]> {
    let flat = |f: &[u32; 3]| f.map(|v| DVec2::from(atlas.uvs[v as usize]));
    atlas.faces.iter().map(flat).collect()
}

/// A point of a face.
fn point(mesh: &Mesh, face: u32, at: [f64; 3]) -> DVec3 {
    let corners = mesh.1[face as usize].map(|v| DVec3::from(mesh.0[v as usize]));
    corners[0] * at[0] + corners[1] * at[1] + corners[2] * at[2]
}

/// Barycentric coordinates that are spread over triangles and include their edges and corners.
fn spread(k: usize) -> [f64; 3] {
    let golden = 0.618_033_988_749_894_9;
    let (mut u, mut v) = ((k as f64 * golden).fract(), (k as f64 * 0.7548).fract());
    if k.is_multiple_of(5) {
        v = 0.0;
    }
    if k.is_multiple_of(35) {
        u = 0.0;
    }
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    [1.0 - u - v, u, v]
}

/// Checks all that holds for every atlas.
fn assert_valid(atlas: &Atlas, mesh: &Mesh) {
    assert_eq!(atlas.faces.len(), mesh.1.len());
    assert_eq!(atlas.charts.len(), mesh.1.len());
    let triangles = flat_triangles(atlas);
    let side = 0.5 * atlas.gutter as f64 / atlas.size as f64 - 1e-9;
    for t in &triangles {
        assert!((t[1] - t[0]).perp_dot(t[2] - t[0]) > 0.0, "{t:?}");
        let inside = |x: f64| (side..=1.0 - side).contains(&x);
        assert!(t.iter().all(|p| inside(p.x) && inside(p.y)), "{t:?}");
    }
    assert!(!any_cross(&triangles), "faces overlap");
    let texels = atlas.texels();
    let mut owner = vec![None; atlas.size * atlas.size];
    for t in texels.list() {
        owner[t.index as usize] = Some(atlas.charts[t.face as usize]);
        let sum: f32 = t.barycentric.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "{t:?}");
    }
    // Bilinear lookups read texels of their own chart only.
    for f in 0..mesh.1.len() {
        for k in 0..4 {
            let uv = atlas.uv(f as u32, spread(4 * f + k));
            let size = atlas.size as f64;
            let (x, y) = (uv[0] * size - 0.5, (1.0 - uv[1]) * size - 0.5);
            for row in [y.floor(), y.ceil()] {
                for column in [x.floor(), x.ceil()] {
                    let at = row as usize * atlas.size + column as usize;
                    assert_eq!(owner[at], Some(atlas.charts[f]), "face {f} at {x} {y}");
                }
            }
        }
    }
}

/// The largest and the mean error of a baked position at points of the surface, in texels.
fn position_error(atlas: &Atlas, mesh: &Mesh) -> [f64; 2] {
    let baked = atlas.texels().bake(|face, at| {
        let p = point(mesh, face, at);
        [p.x as f32, p.y as f32, p.z as f32]
    });
    let (mut most, mut sum) = (0.0f64, 0.0);
    let count = 8 * mesh.1.len();
    for k in 0..count {
        let (face, at) = ((k / 8) as u32, spread(k));
        let found = lookup::<3>(&baked, [atlas.size; 2], atlas.uv(face, at));
        let found = DVec3::from(found.map(f64::from));
        let error = found.distance(point(mesh, face, at)) * atlas.density;
        most = most.max(error);
        sum += error;
    }
    [most, sum / count as f64]
}

#[test]
fn smooth_meshes_have_few_charts_of_equal_density() {
    for (mesh, size, charts) in [
        (ball(5), 256, 8),
        (torus(96, 40, 0.12), 512, 40),
        (noisy_ball(5, 0.01), 256, 12),
    ] {
        let atlas = atlas_of(&mesh, size);
        assert_valid(&atlas, &mesh);
        assert!(atlas.chart_count() <= charts, "{}", atlas.chart_count());
        assert!(atlas.coverage() > 0.45, "{}", atlas.coverage());
        let density = atlas.density / size as f64;
        let mut far = 0;
        for (f, t) in flat_triangles(&atlas).iter().enumerate() {
            let c = mesh.1[f].map(|v| DVec3::from(mesh.0[v as usize]));
            let area = (c[1] - c[0]).cross(c[2] - c[0]).length() * density * density;
            let ratio = (t[1] - t[0]).perp_dot(t[2] - t[0]) / area;
            far += usize::from(!(0.75..1.33).contains(&ratio));
        }
        assert!(50 * far < mesh.1.len(), "{far} of {}", mesh.1.len());
    }
}

#[test]
fn the_sides_of_a_cube_are_its_charts() {
    let mesh = cube(8);
    let atlas = atlas_of(&mesh, 128);
    assert_valid(&atlas, &mesh);
    assert_eq!(atlas.chart_count(), 6);
    let [most, mean] = position_error(&atlas, &mesh);
    assert!(most < 0.75 && mean < 0.1, "{most} {mean}");
    // Twelve edges, of 2 each.
    let pairs = atlas.seam_pairs().len() as f64;
    let expected = 24.0 * atlas.density;
    assert!(
        (expected..1.6 * expected).contains(&pairs),
        "{pairs} {expected}"
    );
}

#[test]
fn baked_positions_are_found_again() {
    for (mesh, size) in [
        (ball(4), 256),
        (torus(60, 24, 0.1), 512),
        (noisy_ball(4, 0.02), 256),
    ] {
        let [most, mean] = position_error(&atlas_of(&mesh, size), &mesh);
        assert!(most < 1.0 && mean < 0.12, "{most} {mean}");
    }
}

#[test]
fn sides_of_seams_are_the_same_points() {
    let mesh = torus(48, 20, 0.1);
    let atlas = atlas_of(&mesh, 256);
    let baked = atlas.texels().bake(|face, at| {
        let p = point(&mesh, face, at);
        [p.x as f32, p.y as f32, p.z as f32]
    });
    let pairs = atlas.seam_pairs();
    assert!(pairs.len() > 100);
    for (a, b) in pairs {
        let [p, q] = [a, b].map(|uv| lookup::<3>(&baked, [256; 2], uv).map(f64::from));
        let distance = DVec3::from(p).distance(q.into()) * atlas.density;
        assert!(distance < 1.5, "{a:?} {b:?}: {distance}");
        assert_ne!(a, b);
    }
    let pairs = atlas.texels().neighbors();
    let steps = pairs.iter().map(|[a, b]| b - a);
    assert!(steps.clone().all(|s| s == 1 || s == 256));
    assert!(steps.filter(|s| *s == 256).count() * 5 > 2 * pairs.len());
}

#[test]
fn meshes_of_few_faces_have_an_atlas() {
    let corners = vec![
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1e-3, 0.0],
        [0.0, 0.0, 7.0],
    ];
    for faces in [
        vec![],
        vec![[0, 1, 2]],
        // Without area.
        vec![[0, 0, 0]],
        vec![[0, 1, 1], [0, 1, 2], [1, 0, 3]],
        // The same face twice, on either side, and three at an edge.
        vec![[0, 1, 2], [0, 1, 2]],
        vec![[0, 1, 2], [0, 2, 1]],
        vec![[0, 1, 2], [0, 1, 3], [1, 0, 3]],
    ] {
        let mesh = (corners.clone(), faces);
        assert_valid(&atlas_of(&mesh, 64), &mesh);
    }
    let empty = atlas_of(&(Vec::new(), Vec::new()), 16);
    assert_eq!((empty.chart_count(), empty.texels().list().len()), (0, 0));
    let texture = empty.texels().bake(|_, _| [1.0]);
    assert_eq!(texture, vec![0.0; 256]);
}

#[test]
fn sizes_do_not_matter() {
    let (positions, faces) = ball(3);
    let expected = atlas_of(&(positions.clone(), faces.clone()), 128);
    for factor in [1e-30, 1e30] {
        let scaled = positions.iter().map(|p| p.map(|x| x * factor));
        let atlas = atlas_of(&(scaled.collect(), faces.clone()), 128);
        assert_eq!(atlas.chart_count(), expected.chart_count());
        let ratio = atlas.density * factor / expected.density;
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
}

#[test]
fn wrong_input_is_an_error() {
    let (positions, faces) = ball(1);
    let error = |positions: &[[f64; 3]], faces: &[[u32; 3]], size, gutter, max_angle| {
        let options = AtlasOptions { gutter, max_angle };
        let atlas = Atlas::new(positions, faces, size, &options);
        atlas.expect_err("an error").to_string()
    };
    let mut wrong = positions.clone();
    wrong[3][1] = f64::NAN;
    assert!(error(&wrong, &faces, 64, 4, 60.0).contains("position 3"));
    wrong[3] = [f64::MAX, 0.0, 0.0];
    wrong[4] = [-f64::MAX, 0.0, 0.0];
    assert!(error(&wrong, &faces, 64, 4, 60.0).contains("size"));
    assert!(error(&positions, &[[0, 1, 999]], 64, 4, 60.0).contains("face 0"));
    assert!(error(&positions, &faces, 4, 2, 60.0).contains("size"));
    assert!(error(&positions, &faces, 64, 1, 60.0).contains("gutter"));
    assert!(error(&positions, &faces, 64, 4, 90.0).contains("max_angle"));
    assert!(error(&positions, &faces, 64, 4, f64::NAN).contains("max_angle"));
    let (positions, faces) = cube(1);
    assert!(error(&positions, &faces, 8, 2, 60.0).contains("charts"));
}

#[test]
fn textures_move_to_other_meshes() {
    let (old, fine) = (ball(4), ball(5));
    let from = atlas_of(&old, 256);
    let color = |p: DVec3| [(3.0 * p.x).sin() as f32, p.y as f32, (p.x * p.z) as f32];
    let texels = from.texels().bake(|face, at| color(point(&old, face, at)));
    let textured = Textured {
        positions: &old.0,
        faces: &old.1,
        uvs: &from.uvs,
        uv_faces: &from.faces,
        texels: &texels,
        shape: [256; 2],
    };
    let to = atlas_of(&fine, 200);
    let moved = transfer::<3>(&textured, &fine.0, &fine.1, &to.texels()).expect("a texture");
    for k in 0..fine.1.len() {
        let at = spread(k);
        let found = lookup::<3>(&moved, [200; 2], to.uv(k as u32, at));
        let expected = color(point(&fine, k as u32, at));
        let error = (0..3).map(|c| (found[c] - expected[c]).abs());
        assert!(error.fold(0.0, f32::max) < 0.1, "{found:?} {expected:?}");
    }
    let short = Textured {
        texels: &texels[1..],
        ..textured
    };
    assert!(transfer::<3>(&short, &fine.0, &fine.1, &to.texels()).is_err());
    assert!(transfer::<3>(&textured, &old.0, &old.1, &to.texels()).is_err());
}

#[test]
fn nearest_points_on_the_right_side_of_a_wall() {
    let positions = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, -0.01],
        [1.0, 0.0, -0.01],
        [0.0, 1.0, -0.01],
    ];
    let tree = NearestFaces::new(&positions, &[[0, 1, 2], [4, 3, 5]]).expect("a tree");
    let from = [0.2, 0.2, 0.1];
    assert_eq!(tree.nearest(from).face, 0);
    assert_eq!(tree.nearest_facing(from, [0.0, 0.0, -1.0]).face, 1);
    assert_eq!(tree.nearest_facing(from, [1.0, 0.0, 0.0]).face, 0);
    assert!(tree.nearest([f64::NAN; 3]).distance.is_infinite());
    assert!(NearestFaces::new(&positions, &[]).is_err());
}

#[test]
fn lookups_are_bilinear_and_repeat() {
    let texels = [0.0, 1.0, 2.0, 3.0];
    let at = |u, v| lookup::<1>(&texels, [2, 2], [u, v])[0];
    assert_eq!(at(0.25, 0.75), 0.0);
    assert_eq!(at(0.75, 0.25), 3.0);
    assert_eq!(at(0.5, 0.5), 1.5);
    assert_eq!(at(1.25, -0.25), 0.0);
    assert_eq!(at(0.0, 0.75), 0.5);
    assert!(at(f64::NAN, 0.0).is_nan());
}
