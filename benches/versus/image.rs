use clap::Args;
use softray::prelude::*;

use crate::{data, load};

#[derive(Args)]
pub struct Images {
    /// Samples a pixel.
    #[arg(long, default_value_t = 256)]
    spp: u32,
}

const SCENES: [(&str, &[u32]); 6] = [
    ("cornell", &[0, 1, 3]),
    ("shadow", &[0, 1]),
    ("sphere", &[0, 1]),
    ("glossy_sphere", &[0, 1]),
    ("lens", &[0, 1]),
    ("motion", &[0, 1]),
];

impl Images {
    pub fn run(&self, visibility: Visibility) {
        for (name, bounces) in SCENES {
            let file = load(name);
            for &b in bounces {
                let path = data(name).join(format!("bounces-{b}.exr"));
                let reference = HostImage::read(&path).expect("a reference");
                let options = RenderOptions::new(file.width, file.height)
                    .with_samples(self.spp)
                    .with_bounces(b)
                    .with_visibility(visibility);
                let image = render(&file.scene, &file.camera, &options).expect("an image");
                let image = HostImage::from_tensor(&image.radiance).expect("values");
                println!(
                    "{name} bounces {b} spp {}: clipped rmse {:.5}  mean/ref {:.5}",
                    self.spp,
                    image.rmse(&reference, true).expect("the same size"),
                    image.mean_ratio(&reference)
                );
            }
        }
    }
}
