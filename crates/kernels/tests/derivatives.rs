//! Renders and differentiates with the kernels alone.

use std::sync::Arc;

use softray_kernels::accel::LastHierarchy;
use softray_kernels::host::{
    Channel, HostMaterial, HostObject, HostProjection, HostScene, HostTexture, MaterialKind,
    ParameterId,
};
use softray_kernels::kernel::{
    Counted, HostSums, KernelScene, SEARCHED, Seen, View, ViewSettings, Wanted, Work,
};
use softray_kernels::model::camera::HostCamera;
use softray_kernels::model::filter::PixelFilter;
use softray_kernels::model::v3;
use softray_kernels::sampling::{EmitterSampling, Sampler, Sequence};

const SIZE: u32 = 8;
const SAMPLES: u32 = 16;

/// A floor and a wall in front of it, of one diffuse material, in the light of a constant environment.
fn corner(albedo: f64) -> HostScene {
    let positions = vec![
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
        [-1.0, 0.0, -1.0],
        [1.0, 1.0, -1.0],
        [-1.0, 1.0, -1.0],
    ];
    let faces = vec![[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]];
    let constant = |value: f64| HostTexture::Constant([value; 3]);
    HostScene {
        objects: vec![HostObject {
            positions,
            faces: faces.into(),
            uvs: None,
            normals: None,
            colors: None,
            tangents: None,
            velocity: None,
            first_material: 0,
            face_materials: Arc::default(),
        }],
        materials: vec![HostMaterial {
            channels: [albedo, 0.0, 1.0, 0.0].map(constant).into(),
            kind: MaterialKind {
                reflects: true,
                ..MaterialKind::default()
            },
            normal_map: None,
        }],
        lights: Vec::new(),
        environment: constant(1.0),
        holes: None,
        shines: true,
    }
}

fn view(albedo: f64) -> View {
    let boxes = LastHierarchy::default();
    let emitters = EmitterSampling::default();
    let scene = KernelScene::new(&mut corner(albedo), emitters, None, &boxes);
    let camera = HostCamera {
        eye: [0.0, 1.0, 3.0].into(),
        target: [0.0, 0.3, 0.0].into(),
        up: [0.0, 1.0, 0.0].into(),
        projection: HostProjection::Perspective { fov_y: 40.0 },
        lens: None,
        half_height: 20f64.to_radians().tan(),
    };
    let settings = ViewSettings {
        width: SIZE,
        height: SIZE,
        cone: 0.0,
        bounces: 2,
        roulette_after: None,
        clamp: None,
        least_roughness: None,
        albedo: false,
        multiple_importance: true,
        sampler: Sampler::new(1, Sequence::Sobol, SIZE as usize, SAMPLES),
        interior: true,
    };
    let diffuse = ParameterId::Material(0, Channel::Diffuse);
    let wanted = Wanted::new(&scene, [diffuse].into_iter());
    let filter = PixelFilter::of_cone(0.1, 0.0);
    View::new(scene.into(), camera, filter.into(), settings, wanted, None)
}

/// The sum of all pixels' means, RGB.
fn image(view: &View) -> [f64; 3] {
    let pixels: Vec<u32> = (0..SIZE * SIZE).collect();
    let mut work = Work::new(view.settings.bounces);
    let sums = view.render(&pixels, 0..SAMPLES, &mut work, &mut Counted::default());
    let mut all = [0.0; 3];
    for sum in sums {
        let own = sum.radiance.as_dvec3() / f64::from(SAMPLES);
        all.iter_mut()
            .zip(own.to_array())
            .for_each(|(a, b)| *a += b);
    }
    all
}

#[test]
fn the_derivative_with_respect_to_an_albedo_is_that_of_differences() {
    let (albedo, step) = (0.6, 0.01);
    let [less, more] = [-step, step].map(|change| image(&view(albedo + change)));
    let view = view(albedo);
    let upstream = Seen {
        radiance: v3(1.0, 1.0, 1.0) * (SAMPLES as f32).recip(),
        ..Seen::default()
    };
    let pixels: Vec<(u32, Seen)> = (0..SIZE * SIZE).map(|pixel| (pixel, upstream)).collect();
    let mut sums = HostSums::new(&view.scene, &view.wanted);
    let mut work = Work::new(view.settings.bounces);
    let searches = (View::typical(&pixels), [0.0; SEARCHED]);
    view.backward(&pixels, None, searches, 0..SAMPLES, &mut work, &mut sums);
    sums.resolve(&view.scene);
    let mut gradient = [0.0; 3];
    let place = (ParameterId::Material(0, Channel::Diffuse), 0..3);
    sums.write(&view.scene, &[place], &mut gradient);
    for channel in 0..3 {
        let difference = (more[channel] - less[channel]) / (2.0 * step);
        let found = gradient[channel];
        assert!(difference > 10.0, "nothing is seen: {difference}");
        assert!(
            (found / difference - 1.0).abs() < 1e-3,
            "{found} {difference}"
        );
    }
}
