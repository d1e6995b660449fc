//! Renders a scene file (OBJ, glTF, PLY, or a scene.json that adds a camera) to a PNG, EXR or PFM file.

mod common;

use std::borrow::Cow;
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use softray::prelude::*;

/// Renders a scene file to an image.
#[derive(Parser)]
pub struct Arguments {
    /// The scene: an .obj, .gltf, .glb or .ply file, or a .json file that adds a camera to one.
    scene: PathBuf,
    /// The output image, .png, .exr or .pfm.
    #[arg(short, long)]
    out: PathBuf,
    /// Name of a camera in the file. Default: the first camera, or one that has the whole scene in view.
    #[arg(long)]
    camera: Option<String>,
    /// Camera position x,y,z.
    #[arg(long, value_parser = triple, allow_hyphen_values = true)]
    eye: Option<[f64; 3]>,
    /// The point x,y,z that the camera looks at.
    #[arg(long, value_parser = triple, allow_hyphen_values = true)]
    target: Option<[f64; 3]>,
    /// Vertical field of view in degrees.
    #[arg(long)]
    fov: Option<f64>,
    /// Image size, such as 512x512 or 512 for a square.
    #[arg(long, value_parser = size)]
    size: Option<(usize, usize)>,
    /// Paths per pixel.
    #[arg(long, default_value_t = 64)]
    spp: u32,
    /// Use more paths where the image is noisy and fewer elsewhere.
    #[arg(long, conflicts_with = "softmax")]
    adaptive: bool,
    /// Bounces after the first surface.
    #[arg(long, default_value_t = 3)]
    bounces: u32,
    /// Limit of the indirect light that a path carries from one lamp, against fireflies. Default: none.
    #[arg(long, conflicts_with = "softmax", value_name = "RADIANCE")]
    clamp: Option<f64>,
    /// Least roughness of surfaces after the first one, against the noise of caustics. Default: none.
    #[arg(long, value_name = "ROUGHNESS")]
    regularize: Option<f64>,
    /// Also write the inputs of Open Image Denoise beside the output: NAME.color.pfm, NAME.albedo.pfm and
    /// NAME.normal.pfm.
    #[arg(long)]
    denoiser_inputs: bool,
    /// Half-angle of the ray cones, in degrees.
    #[arg(long, default_value_t = 0.0)]
    angle: f64,
    /// Radius of the pixel filter beyond the pixel itself, in pixels.
    #[arg(long, default_value_t = 0.0)]
    pixels: f64,
    /// Use the paper's visibility instead of cones: σ in scene units squared, γ in units of the scene's depth.
    #[arg(long, value_parser = pair, value_name = "SIGMA,GAMMA")]
    softmax: Option<[f64; 2]>,
    /// Allow the scene to refer to files outside its folder.
    #[arg(long)]
    outside: bool,
    /// Environment radiance r,g,b.
    #[arg(long, value_parser = triple)]
    environment: Option<[f64; 3]>,
    /// An equirectangular environment map, .hdr or .exr.
    #[arg(long, conflicts_with = "environment")]
    environment_map: Option<PathBuf>,
    /// Sampling of paths: the library's default, or plain as in the paper.
    #[arg(long, value_enum, default_value_t = Sampled::Default)]
    sampling: Sampled,
    /// Random seed. The same seed gives the same image.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Device, by its name in `softray::device::named`: flex, ndarray, wgpu, vulkan, metal, cuda or rocm. Default: the value of BURN_DEVICE, or flex.
    #[arg(long)]
    device: Option<String>,
    /// Exposure of a .png in stops. Default: 0, or a value that shows the lit parts if the picture would be too
    /// bright or too dark. It changes neither an .exr or .pfm nor the comparison with --reference.
    #[arg(long, value_name = "EV", allow_hyphen_values = true)]
    exposure: Option<f64>,
    /// Reference image for a comparison.
    #[arg(long)]
    reference: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Sampled {
    Default,
    Plain,
}

fn numbers<const N: usize>(text: &str, expected: &str) -> Result<[f64; N], String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let numbers = numbers.map_err(|e| e.to_string())?;
    numbers.try_into().map_err(|_| expected.into())
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers(text, "three numbers x,y,z")
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text, "two numbers σ,γ")
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let parse = |n: &str| n.parse::<usize>().map_err(|e| e.to_string());
    Ok((parse(width)?, parse(height)?))
}

fn main() -> Result<(), Box<dyn Error>> {
    common::log();
    run(&Arguments::parse())
}

/// Renders a scene.
///
/// # Errors
/// If a file cannot be read or written, or the scene is not valid.
pub fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    // Checked first, so that nothing is loaded in vain and no result is lost.
    HostImage::check_path(&arguments.out)?;
    let check = |size: (usize, usize)| {
        options(arguments, size).check()?;
        HostImage::check_room(&arguments.out, size.0, size.1)
    };
    arguments.size.map_or(Ok(()), check)?;
    let device = softray::device::named(arguments.device.as_deref())?;
    let (mut scene, mut camera, mut size) = load(arguments, &device)?;
    if let Some(eye) = arguments.eye {
        camera.eye = eye.into();
    }
    if let Some(target) = arguments.target {
        camera.target = target.into();
    }
    if let Some(fov) = arguments.fov {
        camera = camera.with_fov_y(fov);
    }
    if let Some(radiance) = arguments.environment {
        scene = scene.with_environment(radiance);
    }
    if let Some(file) = &arguments.environment_map {
        let map = HostImage::read(file)?.into_tensor(&device);
        scene = scene.with_environment(Environment::map(map));
    }
    size = arguments.size.unwrap_or(size);
    check(size)?;

    let (bar, progress) = common::render_progress("rendering");
    let options = options(arguments, size).with_progress(progress);
    let start = Instant::now();
    let mut image = render(&scene, &camera, &options)?;
    let mut host = HostImage::from_tensor(&image.radiance)?;
    let chosen = arguments.environment.is_some() || arguments.environment_map.is_some();
    let is_model = !arguments
        .scene
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if is_model && !chosen && host.pixels.iter().all(|&v| v == 0.0) {
        eprintln!(
            "the light of the file is not seen: a white environment (--environment r,g,b sets another)"
        );
        scene = scene.with_environment([1.0; 3]);
        image = render(&scene, &camera, &options)?;
        host = HostImage::from_tensor(&image.radiance)?;
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    exposed(&host, arguments).write(&arguments.out)?;
    println!("wrote {}", arguments.out.display());
    if arguments.denoiser_inputs {
        let beside = |name: &str| arguments.out.with_extension(format!("{name}.pfm"));
        host.write(beside("color"))?;
        image.write_albedo(beside("albedo"))?;
        image.write_normals(beside("normal"))?;
    }
    println!("seconds {seconds:.2}");
    // GPUs count rays on request only.
    if image.statistics.rays > 0 {
        let each_second = image.statistics.rays as f64 / seconds;
        println!("rays_per_second {each_second:.0}");
    }
    if let Some(reference) = &arguments.reference {
        let reference = HostImage::read(reference)?;
        println!("rmse {}", host.rmse(&reference, false)?);
        println!("rmse_clipped {}", host.rmse(&reference, true)?);
        println!("mean_ratio {}", host.mean_ratio(&reference));
    }
    Ok(())
}

/// Returns the options of the render.
fn options(arguments: &Arguments, (width, height): (usize, usize)) -> RenderOptions {
    let mut options = RenderOptions::new(width, height)
        .with_samples(arguments.spp)
        .with_bounces(arguments.bounces)
        .with_visibility(match arguments.softmax {
            Some([sigma, gamma]) => Visibility::softmax(sigma, gamma),
            None => Visibility::Cone {
                angle: arguments.angle,
                pixels: arguments.pixels,
            },
        })
        .with_sampling(match arguments.sampling {
            Sampled::Default => Sampling::default(),
            Sampled::Plain => Sampling::paper(),
        })
        .with_seed(arguments.seed);
    if arguments.adaptive {
        options = options.with_adaptive();
    }
    if let Some(radiance) = arguments.clamp {
        options = options.with_indirect_clamp(radiance);
    }
    if let Some(roughness) = arguments.regularize {
        options = options.with_path_regularization(roughness);
    }
    if arguments.denoiser_inputs {
        options = options.with_albedo().with_normals();
    }
    options
}

/// Returns the image to write, with the exposure applied.
fn exposed<'a>(image: &'a HostImage, arguments: &Arguments) -> Cow<'a, HostImage> {
    let ending = arguments.out.extension().unwrap_or_default();
    if !ending.eq_ignore_ascii_case("png") {
        if arguments.exposure.is_some() {
            eprintln!("exposure 0 EV: an .exr or .pfm has the light as it is");
        }
        return Cow::Borrowed(image);
    }
    let stops = arguments.exposure.unwrap_or_else(|| {
        let stops = image.automatic_exposure();
        eprintln!("exposure {stops} EV, chosen for the picture (--exposure sets another)");
        stops
    });
    match stops == 0.0 {
        true => Cow::Borrowed(image),
        false => Cow::Owned(image.exposed(stops)),
    }
}

type Loaded = (Scene, Camera, (usize, usize));

fn load(arguments: &Arguments, device: &Device) -> Result<Loaded, Box<dyn Error>> {
    let limits = LoadLimits::default().with_outside(arguments.outside);
    let mut file = SceneFile::load_within(&arguments.scene, device, &limits)?;
    if !file.scene.has_light() {
        eprintln!("no light in the file: a white environment (--environment r,g,b sets another)");
        file.scene = file.scene.with_environment([1.0; 3]);
    }
    let camera = match &arguments.camera {
        Some(name) => {
            let mut all = file.cameras.iter();
            let names = || file.cameras.iter().map(|c| &c.0).collect::<Vec<_>>();
            let found = all.find(|c| c.0 == *name);
            let (_, camera) = found.ok_or_else(|| format!("--camera is none of {:?}", names()))?;
            camera.clone()
        }
        None if file.cameras.is_empty() => overview(&file.scene)?,
        None => file.camera,
    };
    Ok((file.scene, camera, (file.width, file.height)))
}
