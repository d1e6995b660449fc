//! Measures predictions of objects: silhouettes, volumes, holes and flaws of the surfaces.

use burn::module::Module;
use softray::meshing::{TriangleMesh, signed_distances, volume_iou};
use softray::optim::loss;
use softray::prelude::*;

use super::dataset::Dataset;
use super::network::{Bodies, Decoder, Network};
use super::render::{DISTANCE, half_view, options, see};

/// Paths per pixel of the silhouettes that are compared.
const SAMPLES: u32 = 4;
/// Images per batch of the network.
const AT_ONCE: usize = 16;
/// Points along the longest side of the boxes in which volumes are compared.
const RESOLUTION: usize = 40;

/// Rays along each axis of the input image, and points on each of them, for [`visible_side`].
const RAYS: usize = 32;
const POINTS: usize = 48;

/// What predictions of a data set are worth, means over its objects.
#[derive(Clone, Copy, Debug)]
pub struct Scores {
    /// Intersection over union of silhouettes in the input views and in the others.
    pub silhouettes: [f64; 2],
    /// The same of each object with the prediction for another image.
    pub of_another: [f64; 2],
    /// Intersection over union of the volumes.
    pub volume: f64,
    /// The number of objects with one hole, and of those without, whose prediction has as many, and the number of such
    /// objects.
    pub genus: [[usize; 2]; 2],
    /// Parts of a prediction.
    pub parts: f64,
    /// Folds, crossing faces, and surfaces that are not closed, of all predictions.
    pub flaws: [usize; 3],
}

/// Returns the network's predictions for the input images of a data set, as untracked tensors.
pub fn predict(
    data: &Dataset,
    network: &Network,
    decoder: &Decoder,
    device: &Device,
) -> softray::Result<Bodies> {
    // Without a tape.
    let network = network.valid();
    let all: Vec<usize> = (0..data.items.len()).collect();
    let (mut meshes, mut colors) = (Vec::new(), Vec::new());
    for items in all.chunks(AT_ONCE) {
        let which: Vec<_> = items.iter().map(|&i| (i, 0)).collect();
        let images = data.images(&which, device).radiance;
        let bodies = network.forward(images, decoder)?;
        meshes.extend(bodies.meshes);
        colors.push(bodies.color);
    }
    Ok(Bodies {
        meshes,
        color: Tensor::cat(colors, 0),
        distances: None,
    })
}

/// Returns the mean intersection over union of silhouettes, for the input views and for the other views. The body that is
/// compared with each object is that of another one, `shift` further on.
pub fn overlap(
    data: &Dataset,
    bodies: &Bodies,
    shift: usize,
    device: &Device,
) -> softray::Result<[f64; 2]> {
    let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
    for (i, item) in data.items.iter().enumerate() {
        let scene = bodies.scene((i + shift) % data.items.len(), &item.light);
        let cameras = item.eyes[..data.views].iter();
        let cameras = cameras.map(|eye| eye.camera()).collect();
        let batch = Batch::new(vec![scene], cameras)?;
        let which: Vec<_> = (0..batch.len()).map(|eye| (i, eye)).collect();
        let seen = see(&batch, &options(data.size, SAMPLES))?.opacity;
        let target = data.images(&which, device).opacity;
        for eye in 0..batch.len() {
            let one = |t: &Tensor<3>| t.clone().slice([eye..eye + 1]).squeeze_dim::<2>(0);
            let kind = eye.min(1);
            sums[kind] += loss::iou(&one(&seen), &one(&target), 0.5)?;
            counts[kind] += 1.0;
        }
    }
    Ok([0, 1].map(|kind| sums[kind] / counts[kind]))
}

/// Returns all scores of predictions.
pub fn measure(data: &Dataset, bodies: &Bodies, device: &Device) -> softray::Result<Scores> {
    let (mut volume, mut parts, mut flaws) = (0.0, 0, [0; 3]);
    let mut genus = [[0; 2]; 2];
    for (item, mesh) in data.items.iter().zip(&bodies.meshes) {
        let mesh = TriangleMesh::try_from(mesh)?;
        volume += volume_iou(&mesh, &item.mesh(), RESOLUTION)?;
        let found = mesh.statistics()?;
        parts += found.components;
        let open = usize::from(!found.is_solid());
        let own = [found.folds, found.crossings, open];
        flaws = [0, 1, 2].map(|k| flaws[k] + own[k]);
        let kind = usize::from(item.shape.genus == 0);
        genus[kind][0] += usize::from(found.genus == Some(item.shape.genus));
        genus[kind][1] += 1;
    }
    let count = data.items.len() as f64;
    Ok(Scores {
        silhouettes: overlap(data, bodies, 0, device)?,
        of_another: overlap(data, bodies, 1, device)?,
        volume: volume / count,
        genus,
        parts: parts as f64 / count,
        flaws,
    })
}

/// Returns the overlap of silhouettes with the network's predictions.
pub fn predict_and_overlap(
    data: &Dataset,
    network: &Network,
    decoder: &Decoder,
    device: &Device,
) -> softray::Result<[f64; 2]> {
    overlap(data, &predict(data, network, decoder, device)?, 0, device)
}

/// Returns the mean intersection over union of the true volumes with those of bodies that are exact where the input camera
/// sees them. Behind, they end in the better of two simple ways, a constant thickness or a plane across the view axis,
/// with the thickness or the plane that is best for the object.
pub fn visible_side(data: &Dataset) -> softray::Result<f64> {
    // Distances from the camera along the view axis.
    let at = |k: usize| DISTANCE - 1.0 + 2.0 * (k as f64 + 0.5) / POINTS as f64;
    let film = |i: usize| half_view() * (2.0 * (i as f64 + 0.5) / RAYS as f64 - 1.0);
    let rays = (0..RAYS * RAYS).map(|i| [film(i % RAYS), film(i / RAYS)]);
    let on_ray =
        |[x, y]: [f64; 2]| (0..POINTS).map(move |k| [x * at(k), y * at(k), DISTANCE - at(k)]);
    let points: Vec<[f64; 3]> = rays.flat_map(on_ray).collect();
    let mut sum = 0.0;
    for item in &data.items {
        let distances = signed_distances(&item.mesh(), &points)?;
        let inside: Vec<bool> = distances.iter().map(|&d| d < 0.0).collect();
        let iou = |end: &dyn Fn(usize) -> usize| {
            let (mut both, mut either) = (0.0, 0.0);
            for ray in inside.chunks(POINTS) {
                let Some(first) = ray.iter().position(|&inside| inside) else {
                    continue;
                };
                for (k, &inside) in ray.iter().enumerate().skip(first) {
                    // A ray's part of the volume grows with the square of the distance.
                    let (own, volume) = (k < end(first), at(k).powi(2));
                    both += if own && inside { volume } else { 0.0 };
                    either += if own || inside { volume } else { 0.0 };
                }
            }
            both / either
        };
        let ends = 1..=POINTS;
        sum += ends
            .flat_map(|end| [iou(&|first| first + end), iou(&|first| end.max(first + 1))])
            .fold(0.0, f64::max);
    }
    Ok(sum / data.items.len() as f64)
}
