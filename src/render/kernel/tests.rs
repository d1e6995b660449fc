//! Tests of the packed scene.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use burn::tensor::{Device, Tensor};

use softray_kernels::accel::LastHierarchy;
use softray_kernels::kernel::KernelScene;
#[cfg(feature = "gpu")]
use softray_kernels::kernel::{EdgeSets, LastEdges, Wanted};
use softray_kernels::sampling::EmitterSampling;

#[cfg(feature = "gpu")]
use crate::scene::shapes;
use crate::scene::{ColorTexture, Material, Mesh, Object, Scene};

/// Textured emitters are chosen by their mean radiance over the triangle. The radiance is (1 − cos 2πu)(1 + v). Two
/// triangles show different parts of it, and a third emits a constant.
#[test]
fn a_textured_emitter_is_chosen_by_its_mean_radiance() {
    let device = Device::flex();
    let (width, height) = (64, 16);
    let radiance = |u: f64, v: f64| (1.0 - (std::f64::consts::TAU * u).cos()) * (1.0 + v);
    let texels: Vec<f32> = (0..width * height)
        .flat_map(|i| {
            let u = ((i % width) as f64 + 0.5) / width as f64;
            let v = 1.0 - ((i / width) as f64 + 0.5) / height as f64;
            [0.0, 1.5, 1.5].map(|share| (share * radiance(u, v)) as f32)
        })
        .collect();
    let texels = Tensor::<1>::from_floats(texels.as_slice(), &device);
    let texture = ColorTexture::texture(texels.reshape([height, width, 3]));
    let triangle = |uvs: [[f32; 2]; 3], z: f64, emission: ColorTexture| {
        let corners = [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let uvs = Tensor::<2>::from_floats(uvs, &device);
        let mesh = Mesh::from_host(&corners, vec![[0, 1, 2]], &device).with_uvs(uvs);
        Object::new(mesh).with_material(Material::emitter(emission))
    };
    let uvs = [
        [[0.3f32, 0.2], [0.7, 0.3], [0.5, 0.8]],
        [[0.9, 0.3], [1.3, 0.5], [1.05, 0.9]],
    ];
    let constant = 0.75;
    let scene = Scene::new()
        .with_object(triangle(uvs[0], 0.0, texture.clone()))
        .with_object(triangle(uvs[1], 1.0, texture))
        .with_object(triangle([[0.0; 2]; 3], 2.0, [constant; 3].into()));
    let mut host = scene.host().expect("values");
    let packed = KernelScene::new(
        &mut host,
        EmitterSampling::Power,
        None,
        &LastHierarchy::default(),
    );
    let fine = 400;
    let mean_over = |uvs: [[f32; 2]; 3]| {
        let (mut sum, mut count) = (0.0, 0.0);
        for i in 0..fine {
            for j in 0..fine - i {
                let [b, c] = [i, j].map(|k| (f64::from(k) + 1.0 / 3.0) / f64::from(fine));
                let at = |k: usize| {
                    let [x, y, z] = uvs.map(|uv| f64::from(uv[k]));
                    x + (y - x) * b + (z - x) * c
                };
                sum += radiance(at(0), at(1));
                count += 1.0;
            }
        }
        sum / count
    };
    let wanted = [mean_over(uvs[0]), mean_over(uvs[1]), constant];
    for (k, wanted) in wanted.into_iter().enumerate() {
        let found = f64::from(packed.emitters.get(k).radiance);
        assert!((found / wanted - 1.0).abs() < 0.01, "{k}: {found} {wanted}");
        let chance = f64::from(packed.emitters.fixed[k]);
        let share = wanted / (constant + mean_over(uvs[0]) + mean_over(uvs[1]));
        assert!((chance / share - 1.0).abs() < 0.01, "{k}: {chance} {share}");
    }
}

/// The tree over edges keeps its shape while faces stay and vertices move, on the host and for a GPU.
#[cfg(feature = "gpu")]
#[test]
fn a_tree_over_edges_is_reused_while_faces_stay() {
    let device = Device::flex();
    for for_gpu in [false, true] {
        let (boxes, kept) = (LastHierarchy::default(), LastEdges::default());
        let shape = |level: u32, height: f64, edges: &LastEdges| {
            let ball = shapes::icosphere(level, &device).scaled([1.0, 1.0, height]);
            let scene = Scene::new().with_object(Object::new(ball));
            let mut host = scene.host().expect("values");
            let packed = KernelScene::new(&mut host, EmitterSampling::Power, None, &boxes);
            let wanted = Wanted {
                objects: vec![1],
                ..Wanted::default()
            };
            let sets = EdgeSets::new(&host, &packed, &wanted, edges, for_gpu);
            sets.shapes()[0].clone()
        };
        let first = shape(2, 1.0, &kept);
        assert_eq!(first.edges.iter().filter(|&&e| e != u32::MAX).count(), 480);
        assert!(Arc::ptr_eq(&first, &shape(2, 0.6, &kept)));
        // Without the one before, a flat ball has another tree.
        assert!(first.edges != shape(2, 0.6, &LastEdges::default()).edges);
        assert!(!Arc::ptr_eq(&first, &shape(3, 0.6, &kept)));
    }
}
