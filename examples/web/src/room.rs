//! A lit floor with a ring above it, and derivatives of its image.

use softray::prelude::*;
use wasm_bindgen::prelude::*;

use crate::{Refined, rgba};

/// Where the camera looks, and its distance from there.
const MIDDLE: [f64; 3] = [0.0, 1.0, 0.0];
const DISTANCE: f64 = 6.4;
const FIELD_OF_VIEW: f64 = 40.0;

/// The fixed parts of the scene, and its ring about the origin.
pub(crate) struct Parts {
    pub device: Device,
    fixed: Scene,
    ring: Mesh,
}

impl Parts {
    pub fn new() -> Self {
        let device = Device::flex();
        let square = |side: f64, y: f64, down: bool| {
            let z = if down { -side } else { side };
            let [a, b] = [[-side, y, z], [side, y, z]];
            let [c, d] = [[side, y, -z], [-side, y, -z]];
            Object::new(shapes::quad(a, b, c, d, &device))
        };
        let floor = square(9.0, 0.0, false).with_material(Material::diffuse([0.62, 0.6, 0.57]));
        let lamp = square(0.4, 4.0, true).with_material(Material::emitter([19.0, 18.0, 16.0]));
        let fixed = Scene::new()
            .with_object(floor.with_name("floor"))
            .with_object(lamp.with_name("lamp"))
            .with_environment([0.02, 0.022, 0.028]);
        let ring = shapes::torus(0.48, 0.17, 20, 10, &device)
            .smooth_normals()
            .rotated([1.0, 0.0, 0.4], 24.0);
        Self {
            device,
            fixed,
            ring,
        }
    }

    /// The scene with the ring at a place.
    pub fn scene(&self, place: Parameter<3>) -> Scene {
        let ring = Object::new(self.ring.clone().translated(place)).with_name("ring");
        let orange = Material::diffuse([0.85, 0.32, 0.06]);
        self.fixed.clone().with_object(ring.with_material(orange))
    }
}

/// A camera about the room by its direction in degrees.
fn orbit(azimuth: f64, elevation: f64) -> softray::Result<Camera> {
    let camera = Camera::orbit(MIDDLE, DISTANCE, azimuth, elevation)?;
    Ok(camera.with_fov_y(FIELD_OF_VIEW))
}

/// The room as the visitor sees it.
#[wasm_bindgen]
pub struct Room {
    parts: Parts,
    place: [f64; 3],
    azimuth: f64,
    elevation: f64,
    refined: Refined,
    derived: Option<Derived>,
    /// For the image, and for derivatives.
    caches: [HierarchyCache; 2],
}

#[wasm_bindgen]
impl Room {
    #[wasm_bindgen(constructor)]
    #[expect(
        clippy::new_without_default,
        reason = "it is a constructor of JavaScript"
    )]
    pub fn new() -> Self {
        Self {
            parts: Parts::new(),
            place: [0.0; 3],
            azimuth: 0.0,
            elevation: 0.0,
            refined: Refined::default(),
            derived: None,
            caches: Default::default(),
        }
    }

    /// Sets the place of the ring and the direction of the camera in degrees.
    pub fn set(&mut self, x: f64, y: f64, z: f64, azimuth: f64, elevation: f64) {
        (self.place, self.azimuth, self.elevation) = ([x, y, z], azimuth, elevation);
        self.refined = Refined::default();
        self.derived = None;
    }

    /// Refines the image by a pass. Returns it, or nothing once all passes are done.
    pub fn refine(&mut self, width: usize, height: usize) -> Result<Option<Vec<u8>>, JsError> {
        let scene = self.parts.scene(self.place.into());
        let options = RenderOptions::new(width, height)
            .with_bounces(1)
            .with_cache(&self.caches[0]);
        let camera = orbit(self.azimuth, self.elevation)?;
        let image = self.refined.refine(&scene, &camera, &options)?;
        Ok(image.map(|image| rgba(&image)))
    }

    /// Adds a pass to the derivatives of the mean radiance of pixels, and returns their means so far: four images, by x,
    /// y and z of the ring and by degrees of the camera's turn.
    pub fn derivatives(&mut self, width: usize, height: usize) -> Result<Vec<f32>, JsError> {
        let mut derived = match self.derived.take() {
            Some(derived) => derived,
            None => Derived::new(self)?,
        };
        let options = RenderOptions::new(width, height)
            .with_samples(4)
            .with_bounces(0)
            .with_seed(u64::from(derived.passes))
            .with_cache(&self.caches[1]);
        let (scene, camera) = (&derived.scene, &derived.camera);
        let all = render_derivative(scene, camera, &options, &derived.tangents)?;
        let own = all.tangents.radiance.mean_dim(3);
        let sum = match derived.sum.take() {
            Some(sum) => sum + own,
            None => own,
        };
        derived.passes += 1;
        let mean = sum.clone() / f64::from(derived.passes);
        derived.sum = Some(sum);
        self.derived = Some(derived);
        Ok(mean.into_data().iter::<f32>().collect())
    }
}

/// The room with its derivatives, and the sum of the passes over their images.
struct Derived {
    scene: Scene,
    camera: Camera,
    tangents: Vec<Tangent>,
    sum: Option<Tensor<4>>,
    passes: u32,
}

impl Derived {
    fn new(room: &Room) -> softray::Result<Self> {
        let [x, y, z] = room.place;
        let build = |n: &[f64]| {
            let scene = room.parts.scene([n[0], n[1], n[2]].into());
            Ok((scene, orbit(room.azimuth + n[3], room.elevation)?))
        };
        let (scene, camera, tangents) = Tangent::of_numbers(&[x, y, z, 0.0], build)?;
        Ok(Self {
            scene,
            camera,
            tangents,
            sum: None,
            passes: 0,
        })
    }
}
