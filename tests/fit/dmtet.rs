//! Surfaces of grids of signed distances.

use burn::tensor::{DType, TensorData};
use proptest::prelude::*;
use softray::loss;
use softray::meshing::TriangleMesh;
use softray::modules::{DMTetParams, DMTetParamsConfig, TetrahedralGrid};
use softray::prelude::*;

use super::common::errors::{message, says};

const CELLS: usize = 6;
const NODES: usize = (CELLS + 1).pow(3);

fn grid() -> TetrahedralGrid {
    TetrahedralGrid::new(CELLS, 2.0).expect("a grid")
}

fn tensor<const D: usize>(values: Vec<f64>, tail: [usize; D]) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, tail), (&Device::flex(), DType::F64))
}

/// Distances of one grid from a function of positions.
fn distances(grid: TetrahedralGrid, of: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
    let nodes = grid.nodes(&Device::flex()).into_data().convert::<f64>();
    let nodes = nodes.try_to_vec::<f64>().expect("positions");
    nodes.chunks(3).map(|p| of([p[0], p[1], p[2]])).collect()
}

fn torus([x, y, z]: [f64; 3]) -> f64 {
    (x.hypot(y) - 0.55).hypot(z) - 0.25
}

fn value() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -1.0..1.0f64,
        2 => Just(0.0),
        1 => prop::sample::select(vec![-0.0, 1e-300, -1e-300, 1e30, -1e30, f64::MIN_POSITIVE]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// Any distances and offsets, also at the border, give a closed, oriented, manifold surface whose faces do not cross.
    #[test]
    fn any_surface_is_sound(
        values in prop::collection::vec(value(), NODES),
        offsets in prop::collection::vec(-9.0..9.0f64, 3 * NODES),
    ) {
        let n = CELLS + 1;
        let distances = tensor(values, [1, n, n, n]);
        let offsets = tensor(offsets, [1, n, n, n, 3]);
        for offsets in [None, Some(offsets)] {
            let mesh = grid().surfaces(distances.clone(), offsets).expect("a surface").remove(0);
            let mesh = TriangleMesh::try_from(&mesh).expect("a mesh");
            let found = mesh.statistics().expect("numbers");
            prop_assert!(found.is_solid() && found.crossings == 0, "{:?}", found);
            prop_assert!(found.volume > 0.0);
        }
    }
}

/// The derivatives of all vertices are those of central differences.
#[test]
fn derivatives_are_those_of_differences() {
    let (grid, n) = (TetrahedralGrid::new(12, 2.0).expect("a grid"), 13);
    let shape = [1, n, n, n];
    let start = distances(grid, torus);
    // Numbers without a pattern.
    let noise = |seed: f64, count: usize| -> Vec<f64> {
        (0..count)
            .map(|i| ((i as f64 + seed) * 78.233).sin())
            .collect()
    };
    let ways = [noise(0.1, start.len()), noise(0.7, 3 * start.len())];
    let offsets = noise(0.4, 3 * start.len());
    let at = |t: f64| {
        let move_by = |values: &[f64], way: &[f64]| -> Vec<f64> {
            values.iter().zip(way).map(|(v, w)| v + t * w).collect()
        };
        let distances = tensor(move_by(&start, &ways[0]), shape);
        let offsets = tensor(move_by(&offsets, &ways[1]), [1, n, n, n, 3]);
        (
            distances.autodiff().require_grad(),
            offsets.autodiff().require_grad(),
        )
    };
    let weighted = |distances: &Tensor<4>, offsets: &Tensor<5>| {
        let meshes = grid.surfaces(distances.clone(), Some(offsets.clone()));
        let vertices = meshes.expect("a surface").remove(0).vertices;
        let weights = tensor(noise(0.2, vertices.dims()[0] * 3), vertices.dims());
        (vertices * weights.autodiff()).sum()
    };
    let (distances, offsets) = at(0.0);
    let gradients = weighted(&distances, &offsets).backward();
    let along = |gradient: Vec<f64>, way: &[f64]| -> f64 {
        gradient.iter().zip(way).map(|(g, w)| g * w).sum()
    };
    let read = |data: TensorData| data.try_to_vec::<f64>().expect("a gradient");
    let by_distances = read(distances.grad(&gradients).expect("a gradient").into_data());
    let by_offsets = read(offsets.grad(&gradients).expect("a gradient").into_data());
    assert!(
        by_distances
            .iter()
            .chain(&by_offsets)
            .all(|g| g.is_finite())
    );
    let found = along(by_distances, &ways[0]) + along(by_offsets, &ways[1]);
    let step = 1e-6;
    let [more, less] = [step, -step].map(|t| {
        let (distances, offsets) = at(t);
        weighted(&distances, &offsets).into_scalar::<f64>()
    });
    let expected = (more - less) / (2.0 * step);
    assert!((found / expected - 1.0).abs() < 1e-5, "{found}, {expected}");
}

/// The derivatives of a soft silhouette, of pixels on a torus, in its hole and beside it, are those of central differences.
/// Where the least distance moves from one sample of a ray to another, both are equal, so the silhouette is continuous.
#[test]
fn derivatives_of_soft_silhouettes() {
    let grid = TetrahedralGrid::new(12, 2.0).expect("a grid");
    let (n, start) = (grid.size(), distances(grid, torus));
    let way: Vec<f64> = (0..start.len()).map(|i| (0.3 * i as f64).sin()).collect();
    let camera = |x: f64| Camera::look_at([x, 0.3, 4.0], [0.0; 3]).with_fov_y(32.0);
    // Of the second of two grids.
    let views = [(1, camera(0.4)), (1, camera(-1.0))];
    let at = |t: f64| {
        let values = start.iter().zip(&way).map(|(v, w)| v + t * w);
        let other = start.iter().map(|v| 1.0 - v);
        let values = other.chain(values).collect();
        let distances = tensor(values, [2, n, n, n]).autodiff().require_grad();
        let seen = grid.opacity(distances.clone(), &views, [20, 16], 0.2);
        (distances, seen.expect("a silhouette"))
    };
    let (distances, seen) = at(0.0);
    let shown = seen
        .clone()
        .into_data()
        .try_to_vec::<f64>()
        .expect("opacity");
    let near = |value: f64| shown.iter().any(|&v| (v - value).abs() < 0.05);
    assert!(near(0.7) && near(0.4) && near(0.05));
    let weights: Vec<f64> = (0..640).map(|i| 1.5 + f64::from(i).cos()).collect();
    let weights = tensor(weights, [2, 16, 20]).autodiff();
    let gradients = (seen * weights.clone()).sum().backward();
    let by = distances.grad(&gradients).expect("a gradient").into_data();
    let by = by.try_to_vec::<f64>().expect("numbers");
    let (of_first, by) = by.split_at(start.len());
    assert!(of_first.iter().all(|&g| g == 0.0));
    let found: f64 = by.iter().zip(&way).map(|(g, w)| g * w).sum();
    const STEP: f64 = 1e-5;
    let [more, less] =
        [STEP, -STEP].map(|t| (at(t).1 * weights.clone()).sum().into_scalar::<f64>());
    let expected = (more - less) / (2.0 * STEP);
    assert!(
        expected.abs() > 0.1 && (found / expected - 1.0).abs() < 1e-5,
        "{found}, {expected}"
    );
}

/// Grids of a batch are those of single grids, and render together: a torus, a ball, and all of the cube.
#[test]
fn grids_of_a_batch() {
    let device = Device::flex();
    let grid = TetrahedralGrid::new(10, 2.0).expect("a grid");
    let fields: [fn([f64; 3]) -> f64; 3] = [torus, |[x, y, z]| x.hypot(y).hypot(z) - 0.5, |_| -1.0];
    let lists = fields.map(|field| distances(grid, field));
    let of = |list: &[f64], count| {
        let values: Vec<f32> = list.iter().map(|&v| v as f32).collect();
        Tensor::<1>::from_floats(values.as_slice(), &device).reshape([count, 11, 11, 11])
    };
    let meshes = grid
        .surfaces(of(&lists.concat(), 3), None)
        .expect("surfaces");
    for (mesh, list) in meshes.iter().zip(&lists) {
        let single = grid
            .surfaces(of(list, 1), None)
            .expect("a surface")
            .remove(0);
        assert_eq!(
            (&single.faces, single.vertices.dims()),
            (&mesh.faces, mesh.vertices.dims())
        );
        single
            .vertices
            .into_data()
            .assert_eq(&mesh.vertices.clone().into_data(), true);
    }
    let genus = |mesh: &Mesh| {
        let found = TriangleMesh::try_from(mesh).expect("a mesh").statistics();
        found.expect("numbers").genus
    };
    let found: Vec<_> = meshes.iter().map(genus).collect();
    assert_eq!(found, [Some(1), Some(0), Some(0)]);
    let scene = |mesh| {
        Scene::new()
            .with_object(Object::new(mesh))
            .with_environment([1.0; 3])
    };
    let camera = Camera::look_at([0.0, 0.0, 5.0], [0.0; 3]);
    let batch =
        Batch::new(meshes.into_iter().map(scene).collect(), vec![camera; 3]).expect("a batch");
    let options = RenderOptions::new(16, 16).with_opacity();
    let opacity = render_batch(&batch, &options)
        .expect("images")
        .opacity
        .expect("requested");
    let means = opacity
        .mean_dim(2)
        .mean_dim(1)
        .into_data()
        .try_to_vec::<f32>()
        .expect("means");
    assert!(
        0.03 < means[1] && means[1] < means[0] && means[0] < means[2],
        "{means:?}"
    );
}

/// The surface of a shape from a mesh is that of the mesh, and its distances have the slope 1.
#[test]
fn shapes_of_meshes() {
    let device = Device::flex();
    let cube = TriangleMesh::try_from(&shapes::cube(&device).scaled(0.7)).expect("a mesh");
    let grid = TetrahedralGrid::new(20, 2.0).expect("a grid");
    let shape = DMTetParams::from_mesh(&cube, grid, &device).expect("a shape");
    let volume = |mesh: &TriangleMesh| mesh.volume();
    let found = TriangleMesh::try_from(&shape.mesh().expect("a surface")).expect("a mesh");
    assert!(
        (volume(&found) / volume(&cube) - 1.0).abs() < 0.03,
        "{}",
        volume(&found)
    );
    let off = loss::eikonal(shape.distances.val().unsqueeze(), grid.step()).expect("a penalty");
    let off = off.into_scalar::<f32>();
    // Differences see the edges, where the slope jumps.
    assert!(off < 0.05, "{off}");
}

/// The soft silhouette of a ball, whose distance from a ray is known; rays beside the cube see nothing.
#[test]
fn soft_silhouette_of_a_ball() {
    const SIZE: usize = 12;
    let (radius, softness, height) = (0.5, 0.2, 3.0);
    let ball = DMTetParamsConfig::new(40)
        .with_radius(radius)
        .init(&Device::flex());
    let ball = ball.expect("a ball");
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_orthographic(height);
    let opacity = |views: &[(usize, Camera)], softness| {
        let distances = ball.distances.val().unsqueeze();
        ball.grid().opacity(distances, views, [SIZE; 2], softness)
    };
    let views = [(0, camera.clone())];
    let found = opacity(&views, softness).expect("a silhouette");
    let found = found.into_data();
    let found = found.try_to_vec::<f32>().expect("numbers");
    let place = |i: usize| ((i as f64 + 0.5) / SIZE as f64 - 0.5) * height;
    for (i, &opacity) in found.iter().enumerate() {
        let [x, y] = [place(i % SIZE), place(i / SIZE)];
        let distance = x.hypot(y) - radius;
        let inside = x.abs() < 1.0 && y.abs() < 1.0;
        let expected = if inside {
            1.0 / (1.0 + (distance / softness).exp())
        } else {
            0.0
        };
        assert!(
            (f64::from(opacity) - expected).abs() < 0.01,
            "{x}, {y}: {opacity}, {expected}"
        );
    }
    let object = "grid opacity";
    says(message(opacity(&views, 0.0)), [object, "softness", "0"]);
    says(
        message(opacity(&[], softness)),
        [object, "views", "at least one"],
    );
    let third = [(2, camera)];
    says(
        message(opacity(&third, softness)),
        [object, "grid of a view", "2", "below 1"],
    );
}

#[test]
fn faults_say_where() {
    let n = CELLS + 1;
    let device = Device::flex();
    let ones = || Tensor::<4>::ones([2, n, n, n], &device);
    let place = |value: f32| {
        let part = Tensor::full([1, 1, 1, 1], value, &device);
        ones().slice_assign([1..2, 2..3, 3..4, 4..5], part)
    };
    let error = message(grid().surfaces(place(f32::NAN), None));
    says(
        &error,
        ["distance of grid 1 at [2, 3, 4]", "NaN", "a finite number"],
    );
    let offsets = place(f32::INFINITY)
        .unsqueeze_dim::<5>(4)
        .repeat(&[1, 1, 1, 1, 3]);
    let error = message(grid().surfaces(ones(), Some(offsets)));
    says(&error, ["offset of grid 1 at [2, 3, 4]", "inf"]);
    let error = message(grid().surfaces(Tensor::ones([1, n, n, 5], &device), None));
    says(&error, ["distances", "[1, 7, 7, 5]", "[S, 7, 7, 7]"]);
    let error = message(grid().surfaces(ones(), None));
    says(&error, ["distances of grid 0", "all outside"]);
    says(message(TetrahedralGrid::new(1, 2.0)), ["cells", "2 to 512"]);
    let infinite = DMTetParamsConfig::new(8)
        .with_radius(f64::NAN)
        .init(&device);
    says(message(infinite), ["radius", "NaN"]);
}
