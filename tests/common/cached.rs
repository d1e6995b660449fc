//! Steps of bodies that move in turn, with a cache and without.

use burn::tensor::Device;
use softray::prelude::*;

use super::scenes::diffuse;
use super::tensors::{gradient, leaf, values};

/// Two cubes that pass through each other move one after the other and back again, over a floor of many triangles. Each
/// image and gradient is the one without a cache. There are so few edges that they are drawn from a list: trees over
/// edges depend on the steps before.
pub fn steps_are_those_without_a_cache(device: &Device) {
    let camera = Camera::look_at([1.0, 2.0, 4.0], [0.0, 0.2, 0.0]).with_fov_y(40.0);
    let options = RenderOptions::new(10, 10).with_samples(2).with_bounces(1);
    let cache = HierarchyCache::default();
    let kept = options.clone().with_cache(&cache);
    let floor = shapes::plane_grid(4.0, 4.0, 6, 6, device).translated([0.0, -0.8, 0.0]);
    let step = |sizes: [f32; 2], options: &RenderOptions| {
        let sizes = sizes.map(|size| leaf(&[size], device));
        let [a, b] = &sizes;
        let first = shapes::cube(device).scaled(a.clone());
        let second = shapes::cube(device).scaled(b.clone());
        let second = second.translated([0.31, 0.37, 0.43]);
        let scene = Scene::new()
            .with_object(diffuse(floor.clone(), [0.5, 0.4, 0.3]))
            .with_object(diffuse(first, [0.3, 0.5, 0.6]))
            .with_object(diffuse(second, [0.6, 0.5, 0.3]))
            .with_environment([0.9, 1.0, 1.1]);
        let image = render(&scene, &camera, options).expect("an image");
        let gradients = image.radiance.clone().powf_scalar(2.0).sum().backward();
        let by = sizes.iter().flat_map(|size| gradient(size, &gradients));
        by.chain(values(&image.radiance)).collect::<Vec<f64>>()
    };
    let steps = [
        [0.5, 0.4],
        [0.55, 0.4],
        [0.5, 0.4],
        [0.5, 0.45],
        [0.5, 0.45],
        [0.6, 0.3],
    ];
    for sizes in steps {
        let (found, wanted) = (step(sizes, &kept), step(sizes, &options));
        assert!(wanted[..2].iter().all(|&by| by != 0.0), "{sizes:?}");
        assert_eq!(found, wanted, "{sizes:?}");
    }
    let [built, refitted] = cache.counts();
    println!("boxes built {built} times and refitted {refitted} times");
    assert!(refitted > 0, "the cache kept nothing");
}
