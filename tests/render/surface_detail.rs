//! Colors at corners, normal maps with their tangents, and all of it with alpha masks.

use crate::common::errors::{message, says};
use crate::common::numbers::{apart, furthest, largest};
use crate::common::scenes::diffuse;
use crate::common::tensors::{gradient, gradients_agree, leaf, tensor, values};
use crate::detail::{ENGINES, ball, constant, half_open, lit, options, seen, share_of_close, wall};
use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use burn::tensor::{DType, Device, Tensor};
use softray::gradcheck::{Checked, Estimate, GradCheck, Point, Verdict, gradcheck};
use softray::prelude::*;
use softray::scene::CornerAttribute;

/// A mesh as the reference takes it, with what it returns.
struct ReferenceMesh<'a> {
    mesh: &'a Mesh,
    tables: [Vec<f64>; 3],
    tangents: Vec<[[f32; 4]; 3]>,
}

impl ReferenceMesh<'_> {
    fn row<const C: usize>(&self, table: usize, row: u32) -> [f32; C] {
        std::array::from_fn(|i| self.tables[table][C * row as usize + i] as f32)
    }
}

impl Geometry for ReferenceMesh<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.faces.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.row(0, self.mesh.faces[face][corner])
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        let normals = self.mesh.normals.as_ref().expect("normals");
        self.row(1, normals.faces[face][corner])
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let uvs = self.mesh.uvs.as_ref().expect("texture coordinates");
        self.row(2, uvs.faces[face][corner])
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[face][corner] = tangent.expect("a tangent").tangent_encoded();
    }
}

#[test]
fn tangents_are_those_of_mikktspace() {
    for mesh in [ball(), shapes::sphere(12, 6, &Device::flex())] {
        let table = |a: &Option<CornerAttribute>| values(&a.as_ref().expect("it").values);
        let mut reference = ReferenceMesh {
            mesh: &mesh,
            tables: [
                values(&mesh.vertices),
                table(&mesh.normals),
                table(&mesh.uvs),
            ],
            tangents: vec![[[0.0; 4]; 3]; mesh.faces.len()],
        };
        generate_tangents(&mut reference).expect("tangents");
        let own = mesh.clone().mikktspace_tangents().tangents.expect("it");
        let rows = values(&own.values);
        assert_eq!(own.faces.len(), reference.tangents.len());
        for (f, (spaces, wanted)) in own.faces.iter().zip(&reference.tangents).enumerate() {
            for (&space, wanted) in spaces.iter().zip(wanted) {
                let found = &rows[4 * space as usize..][..4];
                let apart = found.iter().zip(wanted);
                let apart = largest(apart.map(|(a, &b)| a - f64::from(b)));
                assert!(apart < 1e-4, "face {f}: {found:?} {wanted:?}");
            }
        }
    }
}

#[test]
fn gradients_of_tangents() {
    let base = [
        0.0, 0.1, 0.0, 1.0, 0.0, 0.2, 1.1, 1.0, -0.1, -0.1, 0.9, 0.3, 0.0, 0.1, 1.1, 0.2, 0.9, 1.0,
        0.1, 1.2, 0.1, 0.2, 1.0, -0.2, 0.1, 1.0, 0.2, 0.2, 0.9, -0.1, -0.1, 0.8,
    ];
    let part = |p: &Tensor<1>, from: usize, columns: usize| {
        let all = p.clone().slice([from..from + 4 * columns]);
        all.reshape([4, columns])
    };
    for smooth in [true, false] {
        gradients_agree(&base, |p| {
            let mut mesh =
                Mesh::new(part(&p, 0, 3), vec![[0, 1, 2], [0, 2, 3]]).with_uvs(part(&p, 12, 2));
            if smooth {
                mesh = mesh.with_normals(part(&p, 20, 3));
            }
            let tangents = mesh.mikktspace_tangents().tangents.expect("it").values;
            let count = tangents.dims()[0];
            let weights: Vec<f64> = (0..4 * count).map(|i| (1.3 * i as f64).sin()).collect();
            let weights = tensor(&weights, [count, 4], &Device::flex(), DType::F64);
            // What nothing depends on has a gradient of 0, too.
            (tangents * weights).sum() + p.sum() * 0.0
        });
    }
}

#[test]
fn a_flat_normal_map_changes_nothing() {
    let uvs = ball().uvs;
    let smooth = || {
        let mut ball = ball();
        ball.uvs = uvs.clone();
        ball
    };
    let flat: Tensor<3> = constant(&[0.0, 0.0, 0.7, 0.0, 0.0, 1.0], [1, 2, 3]);
    let gloss = Material::phong([0.3; 3], [0.4; 3], 12.0);
    for engine in ENGINES {
        for mesh in [smooth(), smooth().without_normals(), wall()] {
            let without = seen(
                Object::new(mesh.clone()).with_material(gloss.clone()),
                engine,
            );
            let bumpy = gloss.clone().with_normal_map(flat.clone(), 2.0);
            let with = seen(Object::new(mesh).with_material(bumpy), engine);
            // But for rounding, which now and then makes a draw another.
            let share = share_of_close(&without, &with, 1e-3);
            println!("{engine:?}: {} {share}", furthest(&without, &with));
            assert!(share > 0.99, "{engine:?}: {share}");
        }
    }
}

/// A wall whose map is one texel is shaded as one with these normals, seen from either side.
#[test]
fn a_tilt_by_a_map_is_one_of_the_normals() {
    let texel = [0.35, -0.3, 0.9];
    let matt = Material::diffuse([0.6, 0.5, 0.4]);
    let gloss = Material::phong([0.6, 0.5, 0.4], [0.3; 3], 20.0);
    for material in [matt, gloss] {
        let map = material
            .clone()
            .with_normal_map(constant(&texel, [1, 1, 3]), 1.0);
        let turn = Transform::new().with_axis_angle([0.2, 1.0, 0.1], constant(&[23.0], [1]));
        for engine in ENGINES {
            for degrees in [17.0, 166.0] {
                let turned = |mesh: Mesh| mesh.rotated([0.0, 1.0, 0.0], degrees).transformed(&turn);
                let normals = constant(&texel.repeat(4), [4, 3]);
                let tilted = turned(wall().with_normals(normals));
                let expected = seen(Object::new(tilted).with_material(material.clone()), engine);
                let found = seen(
                    Object::new(turned(wall())).with_material(map.clone()),
                    engine,
                );
                assert!(furthest(&found, &expected) < 1e-3, "{engine:?} {degrees}");
                let given = turned(wall().mikktspace_tangents());
                let found = seen(Object::new(given).with_material(map.clone()), engine);
                assert!(furthest(&found, &expected) < 1e-3, "{engine:?} {degrees}");
            }
        }
    }
}

#[test]
fn tangents_move_with_their_mesh() {
    let mesh = ball();
    let moves: [fn(Mesh) -> Mesh; 4] = [
        |m| m.rotated([1.0, 0.3, 0.2], 40.0),
        |m| m.scaled(-0.8),
        |m| m.scaled([-1.0, 1.0, 1.0]),
        |m| {
            m.transformed(
                &Transform::new()
                    .with_scale(constant(&[1.0, -1.0, 1.0], [3]))
                    .with_translation(constant(&[0.2; 3], [3])),
            )
        },
    ];
    for moved in moves {
        let rows = |mesh: Mesh| {
            let t = mesh.tangents.expect("tangents");
            let all = values(&t.values);
            let faces = t.faces.iter().flatten();
            faces
                .flat_map(|&row| {
                    let t = &all[4 * row as usize..][..4];
                    let length = t[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
                    [t[0] / length, t[1] / length, t[2] / length, t[3]]
                })
                .collect::<Vec<_>>()
        };
        let before = rows(moved(mesh.clone().mikktspace_tangents()));
        let after = rows(moved(mesh.clone()).mikktspace_tangents());
        assert!(furthest(&before, &after) < 1e-4);
    }
}

#[test]
fn colors_multiply_the_albedo() {
    let (albedo, color) = ([0.8, 0.7, 0.6], [0.5, 0.9, 0.4]);
    let product: [f64; 3] = std::array::from_fn(|i| albedo[i] * color[i]);
    let mesh = wall();
    let faces = mesh.faces.clone();
    let painted = mesh.with_colors(constant(&color, [1, 3]), vec![[0; 3]; faces.len()]);
    for engine in ENGINES {
        let found = seen(diffuse(painted.clone(), albedo), engine);
        let expected = seen(diffuse(wall(), product), engine);
        assert!(furthest(&found, &expected) < 1e-5, "{engine:?}");
    }
}

/// Two faces of other colors, whose common edge moves.
fn two_colors(point: &Point) -> softray::Result<(Scene, Camera)> {
    let (device, dtype) = (&point.device, point.dtype);
    let rest = [
        -1.0, -1.0, 0.0, 0.0, -1.0, 0.0, 0.3, 1.0, 0.0, -1.0, 1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0,
        0.0,
    ];
    let mut by = [0.0; 18];
    (by[3], by[6]) = (1.0, 0.7);
    let x = point.get("x")?.reshape([1, 1]);
    let vertices = tensor(&rest, [6, 3], device, dtype) + tensor(&by, [6, 3], device, dtype) * x;
    let faces = vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]];
    let colors = tensor(&[0.9, 0.5, 0.1, 0.1, 0.3, 0.8], [2, 3], device, dtype);
    let mesh = Mesh::new(vertices, faces);
    let mesh = mesh.with_colors(colors, vec![[0; 3], [0; 3], [1; 3], [1; 3]]);
    let scene = Scene::new()
        .with_object(diffuse(mesh, [0.9; 3]))
        .with_environment([1.0; 3]);
    Ok((
        scene,
        Camera::look_at([0.2, 0.1, 3.0], [0.0; 3]).with_fov_y(60.0),
    ))
}

#[test]
fn colors_jump_where_faces_meet() {
    let options = RenderOptions::new(8, 8).with_samples(16).with_bounces(0);
    let settings = GradCheck::new(options, &Device::flex())
        .with_precision(0.01)
        .with_seeds(8, 400);
    let parameters = [Checked::new("x", [0.1], 0.05)];
    let report = gradcheck(&parameters, &settings, two_colors).expect("a report");
    println!("{report}");
    assert_eq!(report.rows[0].verdict, Verdict::Agrees);
    let Estimate { mean, error, .. } = report.rows[0].difference;
    assert!(mean.abs() > 20.0 * error, "{mean} ± {error}");
}

/// The gradients of both engines where everything comes together. Rays that meet the outline of a hole pass it in
/// one engine alone, now and then, by rounding.
#[test]
fn engines_agree_on_all_of_it() {
    let device = Device::flex();
    let gradients = |engine: Engine, masked: bool| {
        let place = leaf(&[0.1, 0.2, 0.3], &device);
        let texels = [
            0.2, 0.1, 0.9, -0.3, 0.2, 1.0, 0.1, -0.3, 1.1, -0.1, -0.2, 0.8,
        ];
        let texels = leaf(&texels, &device);
        let paint = leaf(&[0.5, 0.7, 0.9, 0.8, 0.4, 0.6], &device);
        let mut mesh = ball().translated(place.clone());
        let faces: Vec<[u32; 3]> = mesh.faces.iter().map(|f| f.map(|v| v % 2)).collect();
        mesh = mesh.with_colors(paint.clone().reshape([2, 3]), faces);
        let mut material = Material::phong([0.5; 3], [0.3; 3], 9.0);
        if masked {
            material = half_open(material);
        }
        material = material.with_normal_map(texels.clone().reshape([2, 2, 3]), 0.7);
        let (scene, camera) = lit(Object::new(mesh).with_material(material));
        let options = options(engine)
            .with_bounces(2)
            .with_visibility(Visibility::cone(2.865));
        let image = render(&scene, &camera, &options)
            .expect("an image")
            .radiance;
        let by = image.powf_scalar(2.0).sum().backward();
        [&place, &texels, &paint].map(|p| gradient(p, &by))
    };
    for (masked, most) in [(false, 1e-3), (true, 4e-2)] {
        let [kernels, tensors] = ENGINES.map(|engine| gradients(engine, masked));
        for (a, b) in kernels.iter().zip(&tensors) {
            println!("{:e}", apart(a, b));
            assert!(apart(a, b) < most, "{masked}: {a:?} {b:?}");
        }
    }
}

#[test]
fn mistakes_are_errors() {
    let see = |object: Object| {
        message(render(
            &lit(object).0,
            &lit_camera(),
            &options(Engine::Kernels),
        ))
    };
    let bare = || Mesh::new(wall().vertices, wall().faces.to_vec());
    let map =
        |shape| Material::default().with_normal_map(Tensor::zeros(shape, &Device::flex()), 1.0);
    let flat = Material::default().with_normal_map(constant(&[0.0, 0.0, 1.0], [1, 1, 3]), 1.0);
    says(
        see(Object::new(bare()).with_material(flat.clone())),
        ["normal map", "with_uvs"],
    );
    says(
        see(Object::new(wall()).with_material(map([2, 2, 4]))),
        ["normal map", "[2, 2, 4]"],
    );
    says(
        see(Object::new(bare()).with_material(half_open(Material::default()))),
        ["alpha mask", "with_uvs"],
    );
    let nothing = Material::default().with_alpha_mask(constant(&[], [0, 2]), 0.5);
    says(
        see(Object::new(wall()).with_material(nothing)),
        ["alpha mask", "[0, 2]"],
    );
    let never = Material::default().with_alpha_mask(constant(&[f64::NAN], [1, 1]), 0.5);
    says(
        see(Object::new(wall()).with_material(never)),
        ["alpha mask texel (0, 0)"],
    );
    let faces = wall().faces;
    let few = wall().with_colors(constant(&[0.5; 6], [2, 3]), faces.clone());
    says(see(Object::new(few)), ["colors", "under 2"]);
    let side = wall().with_tangents(constant(&[1.0, 0.0, 0.0, 0.5].repeat(4), [4, 4]), faces);
    says(
        see(Object::new(side).with_material(flat)),
        ["tangents 0", "1 or −1"],
    );

    let (scene, camera) = lit(Object::new(wall()).with_material(half_open(Material::default())));
    let soft = options(Engine::Tensors).with_visibility(Visibility::softmax(1e-3, 1e-3));
    says(
        message(render(&scene, &camera, &soft)),
        ["alpha mask", "softmax"],
    );
}

fn lit_camera() -> Camera {
    lit(Object::new(wall())).1
}
