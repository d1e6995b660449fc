use softray::prelude::*;
fn main() {
    let device = Device::flex();
    for gamma in [1e-5, 1e-4, 1e-3, 1e-2, 1e-1] {
        for sigma in [2e-3, 1.2e-4, 1e-6, 1e-8] {
            for k in [2, 4] {
                let scene = |white: bool| {
                    let ball = Object::new(shapes::icosphere(k, &device))
                        .material(Material::diffuse([if white { 1.0 } else { 0.8 }; 3]));
                    let light = shapes::quad(
                        [-0.5, 3.0, -0.5],
                        [0.5, 3.0, -0.5],
                        [0.5, 3.0, 0.5],
                        [-0.5, 3.0, 0.5],
                        &device,
                    );
                    let s = Scene::new().with(ball);
                    if white {
                        s.environment([0.7; 3])
                    } else {
                        s.with(Object::new(light).material(Material::emitter([8.0; 3])))
                    }
                };
                let camera = Camera::look_at([0.0, 1.0, 3.0], [0.0; 3]).fov_y(45.0);
                let options = RenderOptions::new(12, 12)
                    .samples(8)
                    .bounces(0)
                    .blur(sigma, gamma)
                    .with_opacity();
                let a = render(&scene(true), &camera, &options)
                    .unwrap()
                    .mean()
                    .unwrap()[0]
                    / 0.7;
                let i = render(&scene(false), &camera, &options).unwrap();
                let o = i
                    .opacity
                    .as_ref()
                    .unwrap()
                    .clone()
                    .mean()
                    .into_scalar::<f32>();
                println!(
                    "gamma {gamma:e} sigma {sigma:e} faces {:6} furnace {a:.4}  lit {:.4} opacity {o:.4}",
                    20 << (2 * k),
                    i.mean().unwrap()[0]
                );
            }
        }
    }
}
