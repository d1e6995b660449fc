//! Hulls of bodies whose silhouettes are rendered here.

use glam::{DMat3, DVec3};

use crate::meshing::samples::torus_field;
use crate::meshing::{
    HullOptions, Region, RemeshOptions, Silhouette, TriangleMesh, remesh, visual_hull,
};

const SIZE: usize = 128;

/// A camera at a direction from the origin, and its mask.
pub struct View {
    world_to_camera: [[f64; 4]; 3],
    focal: f64,
    pub mask: Vec<f32>,
}

impl View {
    pub fn silhouette(&self) -> Silhouette<'_> {
        Silhouette {
            world_to_camera: self.world_to_camera,
            focal: [self.focal; 2],
            principal: [SIZE as f64 / 2.0; 2],
            width: SIZE,
            height: SIZE,
            mask: &self.mask,
        }
    }

    /// Marches rays through a field of signed distances, positive inside, from a camera at `from` that looks at the
    /// origin. A pixel's value is its coverage, from the smallest distance of its ray to the body.
    pub fn of(field: impl Fn(DVec3) -> f64, from: DVec3, focal: f64) -> Self {
        let back = from.normalize();
        let up = if back.z.abs() > 0.9 {
            DVec3::Y
        } else {
            DVec3::Z
        };
        let right = up.cross(back).normalize();
        let axes = [right, back.cross(right), back];
        let world_to_camera = axes.map(|a| [a.x, a.y, a.z, -a.dot(from)]);
        let turn = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let middle = SIZE as f64 / 2.0;
        let pixel = |i: usize| {
            let (x, y) = ((i % SIZE) as f64 + 0.5, (i / SIZE) as f64 + 0.5);
            let ray =
                turn * DVec3::new((x - middle) / focal, (middle - y) / focal, -1.0).normalize();
            let (mut t, mut most) = (from.length() - 2.5, f64::NEG_INFINITY);
            while t < from.length() + 2.5 {
                let value = field(from + ray * t);
                most = most.max(value / t * focal);
                if most > 1.0 {
                    break;
                }
                t += value.abs().max(0.004) * 0.5;
            }
            (most + 0.5).clamp(0.0, 1.0) as f32
        };
        Self {
            world_to_camera,
            focal,
            mask: (0..SIZE * SIZE).map(pixel).collect(),
        }
    }
}

/// Directions all around, evenly.
pub fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let angle = i as f64 * 2.399_963;
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    })
}

fn views(field: impl Fn(DVec3) -> f64 + Copy, count: usize) -> Vec<View> {
    let at = |d: DVec3| View::of(field, d * 5.0, 150.0);
    directions(count).map(at).collect()
}

const REGION: Region = Region {
    center: [0.0; 3],
    radius: 1.6,
};

fn carve(views: &[View], options: &HullOptions) -> crate::error::Result<TriangleMesh> {
    let silhouettes: Vec<Silhouette> = views.iter().map(View::silhouette).collect();
    visual_hull(&silhouettes, REGION, options)
}

#[test]
fn the_hull_of_a_ball_is_that_ball() {
    let views = views(|p| 1.0 - p.length(), 40);
    let mesh = carve(&views, &HullOptions::default().with_resolution(64)).expect("a hull");
    let found = mesh.statistics().expect("a mesh");
    assert!(
        found.is_solid() && found.genus == Some(0) && found.crossings == 0,
        "{found:?}"
    );
    // The hull contains the ball and comes near to it, by a fraction of a cell of 0.05.
    let radii = mesh.positions.iter().map(|p| DVec3::from(*p).length());
    let (least, most) = radii.fold((9.0f64, 0.0f64), |(a, b), r| (a.min(r), b.max(r)));
    assert!(least > 0.985 && most < 1.06, "{least} {most}");
}

#[test]
fn the_hull_of_a_torus_has_its_hole() {
    let views = views(|p| torus_field(p, 0.3), 24);
    let options = HullOptions::default().with_resolution(64);
    let mesh = carve(&views, &options).expect("a hull");
    let found = mesh.statistics().expect("a mesh");
    assert!(
        found.is_solid() && found.genus == Some(1) && found.components == 1,
        "{found:?}"
    );
    let even = remesh(&mesh, &RemeshOptions::uniform(0.08))
        .expect("a mesh")
        .mesh;
    let found = even.statistics().expect("a mesh");
    assert!(
        found.is_solid() && found.genus == Some(1) && found.crossings == 0,
        "{found:?}"
    );
    assert!(found.even_edges > 0.97, "{found:?}");
}

#[test]
fn two_tori_side_by_side_make_two_handles() {
    let field = |p: DVec3| {
        let ring = |x: f64| {
            let q = p - DVec3::X * x;
            0.16 - (q.truncate().length() - 0.5).hypot(q.z)
        };
        ring(-0.55).max(ring(0.55))
    };
    let mesh = carve(
        &views(field, 40),
        &HullOptions::default().with_resolution(96),
    );
    let mesh = mesh.expect("a hull");
    let found = mesh.statistics().expect("a mesh");
    assert!(
        found.is_solid() && found.genus == Some(2) && found.components == 1,
        "{found:?}"
    );
}

#[test]
fn wrong_views_are_tolerated() {
    let field = |p: DVec3| 1.0 - p.length();
    let mut views = views(field, 40);
    // The half of two masks is missing, and a camera is in the wrong place.
    for view in &mut views[3..5] {
        view.mask[..SIZE * SIZE / 2].fill(0.0);
    }
    views[20].world_to_camera[0][3] += 0.8;
    let options = HullOptions::default().with_resolution(48);
    let volume = |options: &HullOptions| carve(&views, options).expect("a hull").volume();
    let ball = 4.0 / 3.0 * std::f64::consts::PI;
    assert!(volume(&options) < 0.6 * ball);
    let tolerant = volume(&options.with_tolerance(3));
    assert!(
        (0.97..1.25).contains(&(tolerant / ball)),
        "{}",
        tolerant / ball
    );
}

#[test]
fn images_that_cut_the_body_do_not_carve_what_they_do_not_see() {
    let field = |p: DVec3| 1.0 - p.length();
    let mut all = views(field, 30);
    // Of four near cameras, none sees the whole ball.
    let near = directions(4).map(|d| View::of(field, d * 5.0, 500.0));
    all.extend(near);
    let mesh = carve(&all, &HullOptions::default().with_resolution(48)).expect("a hull");
    let ball = 4.0 / 3.0 * std::f64::consts::PI;
    assert!(
        (0.97..1.12).contains(&(mesh.volume() / ball)),
        "{}",
        mesh.volume() / ball
    );
}

#[test]
fn islands_go() {
    let field = |p: DVec3| (0.7 - p.length()).max(0.12 - p.distance(DVec3::new(0.9, 0.7, 0.0)));
    let views = views(field, 40);
    let count = |share: f64| {
        let options = HullOptions::default()
            .with_resolution(64)
            .with_least_part(share);
        carve(&views, &options)
            .expect("a hull")
            .statistics()
            .expect("a mesh")
            .components
    };
    assert_eq!([count(0.0), count(0.01), count(1.0)], [2, 1, 1]);
}

#[test]
fn bad_silhouettes_are_errors() {
    let view = View::of(|p| 1.0 - p.length(), DVec3::X * 5.0, 150.0);
    let good = view.silhouette();
    let fails = |silhouettes: &[Silhouette], options: HullOptions, wanted: &str| {
        let error = visual_hull(silhouettes, REGION, &options).expect_err("an error");
        let shown = error.to_string();
        assert!(shown.contains(wanted), "{shown}");
    };
    let options = HullOptions::default().with_resolution(16);
    fails(&[], options.clone(), "silhouettes is empty");
    fails(&[good], options.clone().with_tolerance(1), "tolerance is 1");
    fails(
        &[good],
        options.clone().with_resolution(0),
        "resolution is 0",
    );
    fails(
        &[good],
        options.clone().with_least_part(2.0),
        "least_part is 2",
    );
    let empty = vec![0.0; SIZE * SIZE];
    let wrong = Silhouette {
        mask: &empty,
        ..good
    };
    fails(
        &[good, wrong],
        options.clone(),
        "silhouettes[1]: mask is empty",
    );
    let wrong = Silhouette { width: 100, ..good };
    fails(
        &[wrong],
        options.clone(),
        "16384 values, expected width × height = 12800 values",
    );
    let wrong = Silhouette {
        focal: [1.0, f64::NAN],
        ..good
    };
    fails(&[wrong], options.clone(), "focal is NaN");
    let mut wrong = good;
    wrong.world_to_camera[1][1] = 2.0;
    fails(&[wrong], options.clone(), "a rotation");
    let mut holes = view.mask.clone();
    holes[7] = f32::NAN;
    let wrong = Silhouette {
        mask: &holes,
        ..good
    };
    fails(&[wrong], options.clone(), "mask[7] is NaN");
    let mut away = good;
    away.world_to_camera[0][3] = 10.0;
    fails(&[good, away], options.clone(), "a region of which");
    let region = Region {
        center: [0.0; 3],
        radius: 0.0,
    };
    let error = visual_hull(&[good], region, &options).expect_err("an error");
    assert!(error.to_string().contains("region.radius is 0"), "{error}");
}
