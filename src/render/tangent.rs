//! Directions in which a scene and its camera change.

use std::collections::{HashMap, HashSet};
use std::fmt;

use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use super::values::{Values, check_same, extrapolated, invalid};
use crate::error::Result;
use crate::geometry::detached;
use crate::scene::{Camera, CornerAttribute, Object, Parameter, Scene, Visit, visit_tensors};
use softray_kernels::host::ParameterId;

/// The step along a direction, relative to the largest value, for tangents of normal maps.
const TANGENT_STEP: f64 = 1e-3;

/// The derivative of all values of a scene and its camera with respect to one number: a direction for
/// [`render_derivative`](super::render_derivative), which has an example.
#[derive(Clone)]
pub struct Tangent {
    /// The values that are not all 0.
    pub(super) values: HashMap<ParameterId, Vec<f64>>,
}

/// The scene and the camera of each view.
pub(crate) type Views = Vec<(Scene, Camera)>;

impl fmt::Debug for Tangent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = self.values.iter();
        f.debug_map()
            .entries(values.map(|(id, values)| (id, values.len())))
            .finish()
    }
}

impl Tangent {
    /// Creates a direction. `set` receives a copy of the scene and the camera in which all values are 0, and replaces
    /// those that change: each value by its derivative, a tensor by one of the same shape.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let (scene, camera) = cornell_box(&device);
    /// // The field of view grows, and the second object moves up.
    /// let tangent = Tangent::new(&scene, &camera, |scene, camera| {
    ///     *camera = camera.clone().with_fov_y(1.0);
    ///     let vertices = &mut scene.objects[1].mesh.vertices;
    ///     let up = Tensor::<2>::from_floats([[0.0, 1.0, 0.0]], &device);
    ///     *vertices = up.expand(vertices.dims());
    /// })?;
    /// let options = RenderOptions::new(8, 8).with_samples(4);
    /// let derivative = render_derivative(&scene, &camera, &options, &[tangent])?;
    /// assert_eq!(derivative.tangents.radiance.dims(), [1, 8, 8, 3]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If `set` adds or removes an object, a light, or an attribute, if a tensor has another number of entries than the
    /// scene's, or if a value is not finite.
    pub fn new(
        scene: &Scene,
        camera: &Camera,
        set: impl FnOnce(&mut Scene, &mut Camera),
    ) -> Result<Self> {
        let (mut own, mut of_camera) = (scene.clone(), camera.clone());
        visit_tensors(&mut own, &mut of_camera, &mut Zero);
        set(&mut own, &mut of_camera);
        let shapes = Values::of(scene, camera)?;
        let tangent = Values::of(&own, &of_camera)?;
        check_same(&tangent, &shapes)?;
        for (id, values) in &tangent.all {
            if let Some(wrong) = values.iter().find(|v| !v.is_finite()) {
                return Err(invalid(*id, wrong, "a finite number"));
            }
        }
        Ok(Self::of(tangent))
    }

    fn of(values: Values) -> Self {
        let all = values.all.into_iter();
        let values = all.filter(|(_, values)| values.iter().any(|&v| v != 0.0));
        Self {
            values: values.collect(),
        }
    }

    /// Returns the scene and the camera that `build` makes of some numbers, and their derivatives with respect to each of
    /// these numbers, in their order.
    ///
    /// The derivatives are differences of scenes, extrapolated to a step of 0 (Ridders 1982, *Accurate computation of
    /// F′(x) and F′(x)F″(x)*). `build` runs up to 12 times for each number, at distances of up to 0.5 from numbers of at
    /// most 1, and up to half of larger ones. A distance at which it returns an error is left out. With f32 tensors, the
    /// derivatives of smooth functions are correct to about five digits. The numbers of faces, lights and texels must not
    /// depend on the numbers.
    ///
    /// ```
    /// use softray::prelude::*;
    /// let device = Device::flex();
    /// let build = |values: &[f64]| {
    ///     let ball = shapes::icosahedron(&device).scaled(values[0]);
    ///     let scene = Scene::new().with_object(Object::new(ball)).with_environment([1.0; 3]);
    ///     Ok((scene, Camera::look_at([0.0, 0.0, values[1]], [0.0; 3])))
    /// };
    /// let (scene, camera, tangents) = Tangent::of_numbers(&[0.5, 3.0], build)?;
    /// let options = RenderOptions::new(8, 8).with_samples(4);
    /// let derivative = render_derivative(&scene, &camera, &options, &tangents)?;
    /// assert_eq!(derivative.tangents.radiance.dims(), [2, 8, 8, 3]);
    /// # Ok::<(), softray::Error>(())
    /// ```
    ///
    /// # Errors
    /// If `build` fails for the numbers themselves or at all distances, if the structure of the scene depends on the
    /// numbers, or if a tensor can't be read.
    pub fn of_numbers(
        numbers: &[f64],
        build: impl Fn(&[f64]) -> Result<(Scene, Camera)>,
    ) -> Result<(Scene, Camera, Vec<Self>)> {
        let (scene, camera) = build(numbers)?;
        let mut build = |numbers: &[f64]| Ok(vec![build(numbers)?]);
        let shapes = [Values::of(&scene, &camera)?];
        let tangents = Self::of_views(numbers, &shapes, &mut build)?;
        Ok((scene, camera, tangents.into_iter().flatten().collect()))
    }

    /// Returns the directions of several views, for each number those of all views. `shapes` has the values of the views.
    pub(crate) fn of_views(
        numbers: &[f64],
        shapes: &[Values],
        build: &mut dyn FnMut(&[f64]) -> Result<Views>,
    ) -> Result<Vec<Vec<Self>>> {
        let mut at = numbers.to_vec();
        let of_number = |(k, &number): (usize, &f64)| {
            let mut difference = |step: f64| -> Result<Vec<Values>> {
                let [plus, minus] = [step, -step].map(|step| {
                    at[k] = number + step;
                    let views = build(&at)?;
                    let values = views.iter().zip(shapes).map(|((scene, camera), shapes)| {
                        let values = Values::of(&with_tangents(scene), camera)?;
                        check_same(&values, shapes)?;
                        Ok(values)
                    });
                    values.collect::<Result<Vec<Values>>>()
                });
                at[k] = number;
                let pairs = plus?.into_iter().zip(minus?);
                Ok(pairs.map(|(a, b)| a.minus(&b, 2.0 * step)).collect())
            };
            let views = extrapolated(number, &mut difference)?;
            Ok(views.into_iter().map(Self::of).collect())
        };
        numbers.iter().enumerate().map(of_number).collect()
    }

    /// Adds the derivatives of the tangents that a render computes for normal maps.
    pub(super) fn completed(mut self, scene: &Scene, camera: &Camera) -> Result<Self> {
        use ParameterId::{Normals, Tangents, Uvs, Vertices};
        let lacking = scene.objects.iter().enumerate();
        let lacking = lacking.filter(|(i, object)| {
            let moves = [Vertices(*i), Uvs(*i), Normals(*i)];
            object.lacks_tangents() && moves.iter().any(|id| self.values.contains_key(id))
        });
        let lacking: Vec<usize> = lacking.map(|(i, _)| i).collect();
        if lacking.is_empty()
            || lacking
                .iter()
                .all(|&i| self.values.contains_key(&Tangents(i)))
        {
            return Ok(self);
        }
        let largest = self
            .values
            .values()
            .flatten()
            .fold(0.0, |a: f64, b| a.max(b.abs()));
        let step = TANGENT_STEP / largest;
        let [plus, minus] = [step, -step].map(|step| {
            let (mut scene, mut camera) = (scene.clone(), camera.clone());
            visit_tensors(
                &mut scene,
                &mut camera,
                &mut Displace {
                    tangent: &self,
                    step,
                },
            );
            Values::of(&with_tangents(&scene), &camera)
        });
        let difference = plus?.minus(&minus?, 2.0 * step);
        let tangents = difference.all.into_iter();
        let tangents = tangents.filter(|(id, _)| lacking.iter().any(|&i| *id == Tangents(i)));
        self.values.extend(tangents);
        Ok(self)
    }
}

/// Returns the scene with the tangents that a render computes for normal maps, a row for each corner: how many corners
/// share a row depends on the vertices, so that it may differ at the ends of a step.
pub(super) fn with_tangents(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    if scene.objects.iter().any(Object::lacks_tangents) {
        for object in scene.objects.iter_mut().filter(|o| o.lacks_tangents()) {
            object.mesh = object.mesh.clone().mikktspace_tangents();
            if let Some(tangents) = &mut object.mesh.tangents {
                let rows: Vec<i32> = tangents
                    .faces
                    .as_flattened()
                    .iter()
                    .map(|&i| i as i32)
                    .collect();
                let rows =
                    Tensor::<1, Int>::from_data(rows.as_slice(), &tangents.values.device().inner());
                let values = tangents.values.clone().select(0, rows);
                let faces = (0..tangents.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]);
                *tangents = CornerAttribute::new(values, faces.collect::<Vec<_>>());
            }
        }
    }
    scene
}

/// Sets all values to 0.
struct Zero;

impl Visit for Zero {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        *tensor = detached(tensor).zeros_like();
    }

    fn parameter<const C: usize>(&mut self, _: ParameterId, p: &mut Parameter<C>) {
        *p = Parameter::Constant([0.0; C]);
    }
}

/// Adds a multiple of a tangent.
struct Displace<'a> {
    tangent: &'a Tangent,
    step: f64,
}

impl Visit for Displace<'_> {
    fn visit<const D: usize>(&mut self, id: ParameterId, tensor: &mut Tensor<D>) {
        if let Some(values) = self.tangent.values.get(&id) {
            let own = detached(tensor);
            let data = TensorData::new(values.clone(), own.shape());
            let by = Tensor::from_data(data, (&own.device(), own.dtype()));
            *tensor = own + by * self.step;
        }
    }
}

/// Moves tensors to a device, outside of their graphs, and turns the constants of the chosen values into tensors.
pub(super) struct OnDevice<'a> {
    pub device: &'a Device,
    pub dtype: DType,
    pub chosen: &'a HashSet<ParameterId>,
}

impl Visit for OnDevice<'_> {
    fn visit<const D: usize>(&mut self, _: ParameterId, tensor: &mut Tensor<D>) {
        *tensor = detached(tensor).to_device(self.device);
    }

    fn parameter<const C: usize>(&mut self, id: ParameterId, p: &mut Parameter<C>) {
        match p {
            Parameter::Tensor(tensor) => self.visit(id, tensor),
            Parameter::Constant(values) if self.chosen.contains(&id) => {
                let data = TensorData::new(values.to_vec(), [C]);
                *p = Parameter::Tensor(Tensor::from_data(data, (self.device, self.dtype)));
            }
            Parameter::Constant(_) => {}
        }
    }
}
