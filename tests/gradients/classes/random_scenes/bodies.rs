//! The bodies of a random scene: shapes, materials, poses, and how they lie beside each other.

use burn::tensor::Tensor;
use softray::prelude::*;

use super::maker::Maker;

/// How a body lies beside the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Relation {
    Apart,
    Touching,
    Crossing,
    Nested,
}

impl Maker<'_> {
    /// The material of a body, which changes the mesh where it needs what corners have. Only what stands apart shines:
    /// where a luminous face meets another one, derivatives of the light between them have no finite variance.
    fn material(&mut self, body: &str, mut mesh: Mesh, apart: bool) -> (Mesh, Material) {
        let kind = self.pick(6);
        let named = |field: &str| format!("{body}: {field}");
        let kinds = ["matt", "matt", "Phong", "metallic", "conductor", "glass"];
        self.description.push(format!("{} {body}", kinds[kind]));
        let mut material = match kind {
            0 | 1 => Material::diffuse(self.albedo(&named("albedo"))),
            2 => {
                let albedo = self.color(&named("albedo"), 0.1, 0.5);
                let specular = self.color(&named("specular"), 0.1, 0.4);
                let value = self.between(3.0, 30.0);
                let shininess = self.number(&named("shininess"), value, 0.3 * value, false);
                Material::phong(albedo, specular, shininess)
            }
            3 => {
                let base = self.albedo(&named("base color"));
                let metallic = self.share(&named("metallic"), 0.1, 0.9);
                let roughness = self.share(&named("roughness"), 0.35, 0.9);
                Material::metallic_roughness(base, metallic, roughness)
            }
            4 => {
                let eta = self.color(&named("eta"), 0.2, 1.5);
                let extinction = self.color(&named("extinction"), 1.5, 4.0);
                let roughness = self.share(&named("roughness"), 0.35, 0.9);
                Material::conductor(eta, extinction, roughness)
            }
            _ => {
                self.refracts = true;
                let value = self.between(1.2, 1.7);
                let ior = self.number(&named("ior"), value, 0.1, false);
                let roughness = self.share(&named("roughness"), 0.4, 0.8);
                Material::dielectric(ior, roughness)
            }
        };
        if kind < 5 && self.unit() < 0.2 && mesh.uvs.is_some() {
            self.description.push("normal map".into());
            let tilt = self.texels(&named("normal map"), -0.2, 0.2);
            let up = self.tensor(&[0.0, 0.0, 1.0], [1, 1, 3]);
            material = material.with_normal_map(tilt + up, 1.0);
        }
        if self.unit() < 0.15 && mesh.uvs.is_some() {
            self.description.push("mask".into());
            self.masked = true;
            let alpha: Vec<f64> = (0..16).map(|_| self.unit()).collect();
            material = material.with_alpha_mask(self.tensor(&alpha, [4, 4]), 0.4);
        }
        if self.unit() < 0.2 {
            self.description.push("colors of vertices".into());
            let rows = mesh.vertices.dims()[0];
            let base: Vec<f64> = (0..3 * rows).map(|_| self.between(0.4, 0.9)).collect();
            let p = self.number(&named("colors of vertices"), 1.0, 0.1, false);
            let colors = self.tensor(&base, [rows, 3]) * p.reshape([1, 1]);
            let faces = mesh.faces.clone();
            mesh = mesh.with_colors(colors, faces);
        }
        if self.unit() < 0.15 && apart {
            self.description.push("it shines".into());
            material = material.with_emission(self.albedo(&named("emission")));
        }
        (mesh, material)
    }

    fn shape(&mut self, upright: bool) -> Mesh {
        let d = &self.device.clone();
        let (name, mesh) = match if upright { 0 } else { self.pick(8) } {
            0 | 1 => ("cube", shapes::cube(d).scaled(0.7)),
            2 => ("icosahedron", shapes::icosahedron(d)),
            3 => ("icosphere", shapes::icosphere(1, d)),
            4 => ("sphere", shapes::sphere(10, 6, d)),
            5 => ("smooth ball", shapes::icosphere(1, d).smooth_normals()),
            6 => ("cylinder", shapes::cylinder(0.6, 1.4, 9, d)),
            _ => ("torus", shapes::torus(0.7, 0.3, 9, 6, d)),
        };
        self.description.push(name.into());
        self.with_coordinates(mesh)
    }

    /// A mesh with texture coordinates: those that it has, or else as it is seen from one side, without a seam.
    pub fn with_coordinates(&self, mesh: Mesh) -> Mesh {
        if mesh.uvs.is_some() {
            return mesh.cast(self.dtype);
        }
        let places = mesh.host_vertices().expect("vertices");
        let uvs = places
            .iter()
            .flat_map(|[x, y, z]| [x + 0.3 * z, y - 0.2 * z]);
        let uvs: Vec<f64> = uvs.collect();
        let uvs = self.tensor(&uvs, [places.len(), 2]);
        mesh.cast(self.dtype).with_uvs(uvs)
    }

    /// A body of a radius about a place, which depends on the numbers of its pose.
    fn body(
        &mut self,
        name: &str,
        at: [f64; 3],
        radius: f64,
        [upright, apart]: [bool; 2],
    ) -> Object {
        let named = |field: &str| format!("{name}: {field}");
        let shape = self.shape(upright);
        let (mut mesh, material) = self.material(name, shape, apart);
        let rows = mesh.vertices.dims()[0];
        if !upright {
            let row = self.pick(rows);
            let mut one = vec![0.0; rows];
            one[row] = 1.0;
            let shift = self.along(&named("vertex"), [0.0; 3], 0.3, true);
            let shift = self.tensor(&one, [rows, 1]) * shift.reshape([1, 3]);
            let vertices = mesh.vertices.clone() + shift;
            mesh = mesh.with_vertices(vertices);
            let scale = self.number(&named("scale"), radius, 0.15, true);
            mesh = mesh.scaled(scale);
        } else {
            mesh = mesh.scaled(radius);
        }
        let axis = if upright {
            [0.0, 1.0, 0.0]
        } else {
            self.direction()
        };
        let turn = self.between(6.0, 80.0);
        let turn = self.number(&named("rotation"), turn, 18.0, true);
        mesh = mesh.rotated(axis, turn);
        let place = if upright {
            let p = self.number(&named("translation"), 0.0, 0.2, true);
            self.tensor(&at, [3]) + p * self.tensor(&[0.8, 0.0, 0.6], [3])
        } else {
            self.along(&named("translation"), at, 0.2, true)
        };
        let mut object = Object::new(mesh.translated(place));
        if self.unit() < 0.25 {
            self.description.push("it moves".into());
            let speed = self.between(0.1, 0.4);
            let direction = match upright {
                true => [0.6, 0.0, -0.8],
                false => self.direction(),
            };
            let speed = self.number(&named("velocity"), speed, 0.3, true);
            object = object.with_velocity(speed * self.tensor(&direction, [3]));
        }
        object.with_name(name).with_material(material)
    }

    /// Two bodies and perhaps a floor.
    pub fn bodies(&mut self) -> Vec<Object> {
        let relations = [
            Relation::Apart,
            Relation::Touching,
            Relation::Crossing,
            Relation::Crossing,
            Relation::Nested,
        ];
        let relation = relations[self.pick(5)];
        self.description.push(format!("{relation:?}"));
        let touching = relation == Relation::Touching;
        let mut objects = Vec::new();
        let mut apart = relation == Relation::Apart;
        if touching || self.unit() < 0.6 {
            apart = false;
            let d = self.device.clone();
            let cells = 1 + self.pick(3);
            let floor = shapes::plane_grid(5.0, 5.0, cells, cells, &d).cast(self.dtype);
            let (floor, material) = self.material("floor", floor, false);
            objects.push(
                Object::new(floor)
                    .with_name("floor")
                    .with_material(material),
            );
        }
        let (r, s) = (self.between(0.4, 0.6), self.between(0.3, 0.5));
        let mut first = self.vector(-0.3, 0.3);
        first[1] += 0.7;
        let away = self.direction();
        let distance = match relation {
            Relation::Apart | Relation::Touching => 1.9 * (r + s),
            Relation::Crossing => self.between(0.4, 0.8) * (r + s),
            Relation::Nested => 0.1,
        };
        let mut second: [f64; 3] = std::array::from_fn(|i| first[i] + away[i] * distance);
        let s = if relation == Relation::Nested {
            0.4 * r
        } else {
            s
        };
        if touching {
            // It is a cube, and stands on the floor.
            second[1] = 0.7 * s;
        }
        objects.push(self.body("first", first, r, [false, apart]));
        objects.push(self.body("second", second, s, [touching, apart]));
        objects
    }

    pub fn crossing_bodies(&mut self) -> (Scene, Camera) {
        let [r, s] = [self.between(0.4, 0.6), self.between(0.3, 0.5)];
        let away = self.direction();
        let distance = self.between(0.5, 0.9) * (r + s);
        let body = |maker: &mut Self, name: &str, at: Tensor<1>, radius: f64, cube: bool| {
            let mesh = maker.shape(cube).without_normals().scaled(radius);
            let mesh = mesh.rotated(maker.direction(), maker.between(6.0, 80.0));
            let color = if maker.pick(5) == 0 { 0.0 } else { 0.8 };
            maker.description.push(format!("{name} of {color}"));
            let material = Material::diffuse([color; 3]);
            Object::new(mesh.translated(at))
                .with_name(name)
                .with_material(material)
        };
        let at = self.tensor(&[0.0, 0.7, 0.0], [3]);
        let first = body(self, "first", at, r, true);
        let at = std::array::from_fn(|i| [0.0, 0.7, 0.0][i] + away[i] * distance);
        let at = self.along("second: translation", at, 0.1, true);
        let second = body(self, "second", at, s, false);
        let mut scene = Scene::new().with_object(first).with_object(second);
        if self.pick(3) == 0 {
            self.description.push("lamp".into());
            let d = self.device.clone();
            let lamp = shapes::plane_grid(0.8, 0.8, 1, 1, &d).cast(self.dtype);
            let lamp = lamp.rotated([1.0, 0.0, 0.0], 180.0);
            let lamp = Object::new(lamp.translated([0.3, 2.6, 0.8]));
            scene = scene.with_object(lamp.with_material(Material::emitter([8.0; 3])));
        } else {
            scene = scene.with_environment([0.5; 3]);
        }
        let camera = Camera::look_at([0.4, 1.8, 4.5], [0.0, 0.7, 0.0]).with_fov_y(30.0);
        (scene, camera.with_up([0.2, 1.0, 0.0]))
    }
}
