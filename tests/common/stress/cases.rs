//! The scenes, by name.

use burn::tensor::Device;
use softray::prelude::*;

use super::{Thing, World};
use crate::common::scenes::facing_up;

const FORMS: [Visibility; 3] = [
    Visibility::Cone {
        angle: 0.0,
        pixels: 0.5,
    },
    Visibility::Cone {
        angle: 5.73,
        pixels: 0.0,
    },
    Visibility::softmax(1e-3, 1e-3),
];

/// Scenes that have to give finite images and gradients, by name.
pub fn cases() -> Vec<(String, World)> {
    let mut all: Vec<(String, World)> = Vec::new();
    let groups = [
        ("geometry", geometry()),
        ("view", views()),
        ("light", lights()),
        ("surface", surfaces()),
        ("size", sizes()),
    ];
    for (group, named) in groups {
        for (name, world) in named {
            for form in FORMS {
                let options = world.options.clone().with_visibility(form);
                let world = world.clone().with(|w| w.options = options);
                all.push((format!("{group}: {name}, {form:?}"), world));
            }
        }
    }
    let mut blurred = |form: Visibility| {
        let options = World::new().options.with_visibility(form);
        let world = World::new().with(|w| w.options = options);
        all.push((format!("blur: {form:?}"), world));
    };
    for angle in [1e-9, 0.05, 2.0, 17.0, 28.0] {
        for pixels in [0.0, 1e-6, 3.0, 100.0] {
            blurred(Visibility::Cone { angle, pixels });
        }
    }
    for sigma in [1e-14, 1e-10, 1e-6, 1e-2, 1.0, 1e2, 1e4] {
        for gamma in [1e-8, 1e-4, 1.0, 1e2] {
            for epsilon in [0.0, 1e-3, 1.0] {
                blurred(
                    SoftmaxOptions::new(sigma, gamma)
                        .with_epsilon(epsilon)
                        .into(),
                );
            }
        }
    }
    all
}

type Named = Vec<(&'static str, World)>;

#[expect(clippy::too_many_lines, reason = "a list of scenes")]
fn geometry() -> Named {
    let device = Device::flex();
    let extra = |thing: Thing| World::new().with(|w| w.things.push(thing));
    let triangle = |corners| Thing::triangle("extra", corners);
    let base = || World::new();
    let ball = |at, size| Thing::shape("extra", shapes::icosahedron(&device), at, size);
    let flat = |mesh| Thing::shape("extra", mesh, [0.0; 3], 1.0);
    vec![
        (
            "sliver, aspect 1e6",
            extra(triangle([
                [-1.0, 0.5, 0.5],
                [1.0, 0.5, 0.5],
                [0.0, 0.5 + 2e-6, 0.5],
            ])),
        ),
        (
            "sliver, aspect 1e6, sharp corner",
            extra(triangle([
                [-1.0, 0.5, 0.5],
                [1.0, 0.5, 0.5],
                [1.0, 0.5 + 2e-6, 0.5],
            ])),
        ),
        (
            "three corners on a line",
            extra(triangle([
                [-1.0, 0.5, 0.5],
                [0.0, 0.5, 0.5],
                [1.0, 0.5, 0.5],
            ])),
        ),
        (
            "three corners in one point",
            extra(triangle([[0.1, 0.5, 0.5]; 3])),
        ),
        (
            "two corners in one point",
            extra(triangle([
                [0.1, 0.5, 0.5],
                [0.1, 0.5, 0.5],
                [0.5, 0.9, 0.5],
            ])),
        ),
        (
            "a face that names a vertex twice",
            base().with(|w| w.thing("floor").faces.push([0, 0, 1])),
        ),
        (
            "a face twice",
            base().with(|w| w.thing("floor").faces.push([0, 1, 2])),
        ),
        (
            "a face twice, the other way round",
            base().with(|w| w.thing("floor").faces.push([2, 1, 0])),
        ),
        (
            "coplanar triangles that overlap",
            extra(flat(facing_up([-1.0, 1.5], [-1.0, 1.0], 0.0, &device))),
        ),
        ("an object twice", {
            let mut w = base();
            let again = Thing {
                name: "extra",
                ..w.thing("ball").clone()
            };
            w.things.push(again);
            w
        }),
        (
            "meshes that pass through each other",
            extra(ball([0.7, 0.8, 0.2], 0.6)),
        ),
        (
            "a ball half under the floor",
            extra(ball([-0.5, 0.0, 0.0], 0.5)),
        ),
        (
            "inside out",
            base().with(|w| {
                let faces = &mut w.thing("ball").faces;
                faces.iter_mut().for_each(|f| f.reverse());
            }),
        ),
        (
            "one face turned",
            base().with(|w| w.thing("ball").faces[3].reverse()),
        ),
        (
            "a triangle through the camera",
            extra(triangle([
                [-1.0, 1.6, 4.0],
                [1.3, 1.6, 4.0],
                [0.3, 1.7, 3.0],
            ])),
        ),
        (
            "a triangle behind the camera",
            extra(triangle([
                [-1.0, 1.0, 6.0],
                [1.3, 1.0, 6.0],
                [0.3, 3.0, 6.0],
            ])),
        ),
        (
            "edge-on to the camera",
            extra(triangle([
                [0.3, 1.6, 2.0],
                [0.3, 2.6, 0.0],
                [0.3, 0.6, -1.0],
            ])),
        ),
        ("a tiny ball", extra(ball([-0.2, 0.5, 0.5], 1e-7))),
        ("a huge ball around", extra(ball([0.0; 3], 1e5))),
        (
            "neighbors of very different size",
            extra(Thing::new(
                "extra",
                vec![
                    [0.0, 0.5, 0.5],
                    [1e-7, 0.5, 0.5],
                    [0.0, 0.5 + 1e-7, 0.5],
                    [-1.0, 1.5, 0.5],
                ],
                vec![[0, 1, 2], [0, 2, 3]],
            )),
        ),
    ]
}

fn views() -> Named {
    let base = World::new;
    let seen = |eye, target| base().with(|w| (w.eye, w.target) = (eye, target));
    vec![
        // The middle of the middle pixel of an odd image is the view axis, up to the jitter.
        ("at a vertex", {
            let at = base().thing("triangle").vertices[2];
            seen([0.3, 1.6, 4.0], at)
        }),
        ("along an edge", {
            let [a, b] = [0, 1].map(|i| base().thing("triangle").vertices[i]);
            let back: [f64; 3] = std::array::from_fn(|i| a[i] - 2.0 * (b[i] - a[i]));
            seen(back, a).with(|w| w.fov = 1e-3)
        }),
        ("in the plane of the floor", {
            seen([0.0, 0.0, 5.0], [0.0; 3]).with(|w| w.fov = 1e-3)
        }),
        (
            "parallel to the floor",
            seen([0.0, 0.5, 5.0], [0.0, 0.5, 0.0]),
        ),
        ("inside the ball", seen([0.4, 0.7, 0.0], [0.5, 0.7, 0.0])),
        ("on the floor", seen([0.0, 0.0, 1.5], [0.4, 0.7, 0.0])),
        ("on a vertex", {
            let at = base().thing("triangle").vertices[0];
            seen(at, [0.4, 0.7, 0.0])
        }),
        ("at the light", seen([0.0, 2.5, 0.0], [0.3, 0.0, 0.2])),
        (
            "far away",
            seen([3.0, 1e4, 4e4], [0.0, 0.7, 0.0]).with(|w| w.fov = 0.01),
        ),
        ("nothing in view", seen([0.0, 1.0, 8.0], [0.0, 1.0, 20.0])),
        ("fov 1°", base().with(|w| w.fov = 1.0)),
        ("fov 175°", base().with(|w| w.fov = 175.0)),
        ("aperture 0", base().with(|w| w.lens = Some((0.0, 4.0)))),
        ("aperture 1e-6", base().with(|w| w.lens = Some((1e-6, 4.0)))),
        ("aperture 10", base().with(|w| w.lens = Some((10.0, 4.0)))),
        (
            "focus at the lens",
            base().with(|w| w.lens = Some((0.1, 1e-6))),
        ),
        (
            "focus at infinity",
            base().with(|w| w.lens = Some((0.1, 1e6))),
        ),
        (
            "up nearly along the view",
            base().with(|w| w.up = [0.075, 0.225, 1.001]),
        ),
        ("a long up", base().with(|w| w.up = [0.0, 1e9, 0.0])),
    ]
}

fn lights() -> Named {
    let base = World::new;
    let height = |h: f64| {
        base().with(|w| {
            let light = w.thing("light");
            light.vertices.iter_mut().for_each(|v| v[1] = h);
        })
    };
    let radiance = |v: f64| base().with(|w| w.thing("light").emission = Some([v; 3]));
    vec![
        ("in the floor", height(0.0)),
        ("on the floor", height(1e-6)),
        ("under the floor", height(-0.5)),
        ("without area", {
            base().with(|w| {
                let light = w.thing("light");
                light.vertices = vec![[0.0, 2.5, 0.0]; 4];
            })
        }),
        ("a line", {
            base().with(|w| {
                let light = w.thing("light");
                light.vertices.iter_mut().for_each(|v| v[2] = 0.0);
            })
        }),
        ("behind everything", height(-50.0)),
        ("stands on the floor", {
            base().with(|w| {
                w.thing("light").vertices = vec![
                    [-1.0, 0.0, 0.2],
                    [1.0, 0.0, 0.2],
                    [1.0, 1.0, 0.2],
                    [-1.0, 1.0, 0.2],
                ];
            })
        }),
        ("a thousand", {
            base().with(|w| {
                w.options = w.options.clone().with_bounces(1);
                let (mut vertices, mut faces) = (Vec::new(), Vec::new());
                for i in 0..1000u32 {
                    let (x, z) = (f64::from(i % 32) / 8.0 - 2.0, f64::from(i / 32) / 8.0 - 2.0);
                    vertices.extend([[x, 2.5, z], [x + 0.1, 2.5, z], [x, 2.5, z + 0.1]]);
                    faces.push([3 * i, 3 * i + 1, 3 * i + 2]);
                }
                let light = w.thing("light");
                (light.vertices, light.faces) = (vertices, faces);
            })
        }),
        ("radiance 1e-12", radiance(1e-12)),
        ("radiance 1e12", radiance(1e12)),
        ("radiance 0", radiance(0.0)),
        ("no environment", base().with(|w| w.environment = [0.0; 3])),
        (
            "environment 1e12",
            base().with(|w| w.environment = [1e12; 3]),
        ),
        ("a ball of light", {
            base().with(|w| w.thing("ball").emission = Some([2.0; 3]))
        }),
        (
            "moving",
            base().with(|w| w.thing("light").velocity = Some([0.5, -0.5, 0.2])),
        ),
    ]
}

fn surfaces() -> Named {
    let base = World::new;
    let ball = |f: &dyn Fn(&mut Thing)| base().with(|w| f(w.thing("ball")));
    let shiny = |n: f64| ball(&move |t| t.gloss = Some(([0.3; 3], n)));
    let velocity = |v: [f64; 3]| ball(&move |t| t.velocity = Some(v));
    let floor = |size: [usize; 2], texel: f64, uv: f64| {
        base().with(|w| {
            let uvs = vec![[0.0, 0.0], [uv, 0.0], [uv, uv], [0.0, uv]];
            let texels = vec![texel; size[0] * size[1] * 3];
            w.thing("floor").texture = Some((size, texels, uvs));
        })
    };
    vec![
        ("black", ball(&|t| (t.diffuse, t.gloss) = ([0.0; 3], None))),
        (
            "black, with a lobe",
            ball(&|t| (t.diffuse, t.gloss) = ([0.0; 3], Some(([0.0; 3], 5.0)))),
        ),
        ("white", ball(&|t| (t.diffuse, t.gloss) = ([1.0; 3], None))),
        (
            "specular only",
            ball(&|t| (t.diffuse, t.gloss) = ([0.0; 3], Some(([1.0; 3], 50.0)))),
        ),
        ("shininess 0", shiny(0.0)),
        ("shininess 1e-3", shiny(1e-3)),
        ("shininess 1e5", shiny(1e5)),
        ("velocity 0", velocity([0.0; 3])),
        ("velocity 1e3", velocity([1e3, 0.0, 0.0])),
        ("velocity towards the camera", velocity([-0.1, 0.9, 4.0])),
        ("texture 1 × 1", floor([1, 1], 0.5, 1.0)),
        ("texture 2 × 3", floor([2, 3], 0.5, 1.0)),
        ("uv 1e6", floor([4, 4], 0.5, 1e6)),
        ("uv all 0", floor([4, 4], 0.5, 0.0)),
    ]
}

fn sizes() -> Named {
    let base = World::new;
    let of = |width, height| {
        let options = RenderOptions::new(width, height)
            .with_samples(2)
            .with_bounces(1);
        base().with(|w| w.options = options)
    };
    let change = |f: &dyn Fn(RenderOptions) -> RenderOptions| {
        base().with(|w| w.options = f(w.options.clone()))
    };
    vec![
        ("1 × 1", of(1, 1)),
        ("1 × 512", of(1, 512)),
        ("512 × 1", of(512, 1)),
        ("one sample", change(&|o| o.with_samples(1))),
        ("no bounce", change(&|o| o.with_bounces(0))),
        (
            "64 bounces",
            change(&|o| o.with_samples(1).with_bounces(64)),
        ),
        (
            "roulette at once",
            change(&|o| o.with_bounces(8).with_russian_roulette(0)),
        ),
        (
            "roulette never",
            change(&|o| o.with_bounces(3).with_russian_roulette(100)),
        ),
        ("one ray a tile", {
            let options = RenderOptions::new(2, 2)
                .with_samples(2)
                .with_bounces(1)
                .with_rays_per_tile(1);
            base().with(|w| w.options = options)
        }),
        ("one triangle", {
            base().with(|w| w.things.retain(|t| t.name == "triangle"))
        }),
    ]
}
