//! A path from its first surface on: points of surfaces, light from emitters and maps, where it goes.

use glam::DVec3;

use super::forward::Path;
use super::records::{Connection, Gathered, Hit, Lit, Next, Ray, Vertex, Work};
use super::shading::Shade;
use super::surface::Place;
use super::{Finders, Fused};
use crate::transport::sky::SkyMap;
use crate::visibility::{HostRay, Span};

impl Fused {
    /// Follows a path from a surface of a camera ray on.
    #[inline(always)]
    pub(super) fn walk<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        camera: &Ray,
        drawn: Option<usize>,
        share: f64,
        work: &mut Work,
    ) {
        let settings = &self.settings;
        let epsilon = self.scene.context.epsilon();
        let (mut origin, mut direction) = (camera.origin, camera.direction);
        let mut throughput = DVec3::splat(share);
        let mut drawn = drawn;
        let mut ray: Option<Ray> = None;
        let mut emitter = path.emitter;
        let (sky, map) = (self.missed(), self.gathered());
        let combined = settings.sampling.multiple_importance && !self.lights.is_empty();
        for bounce in 0..=settings.bounces {
            let useful = drawn.filter(|&i| self.useful(work.surfaces[i].triangle));
            let Some(surface) = useful else {
                if let (Some(sky), None) = (sky, drawn) {
                    let light = throughput * sky.at(direction);
                    path.bring::<KEEP>(bounce, light, work);
                }
                if KEEP {
                    work.vertices
                        .push(Vertex::new(ray, drawn, throughput, None));
                }
                return;
            };
            let hit = self.hit(surface, origin, direction, work);
            if KEEP {
                // What comes of it is set below.
                let vertex = Vertex::new(ray.take(), drawn, throughput, Some(hit.clone()));
                work.vertices.push(vertex);
            }
            let last = bounce == settings.bounces;
            let goes_on = !last || sky.is_some();
            let by_scattering = combined && hit.shade.specular.is_some();
            let mut after = emitter;
            let mut scatter = None;
            if goes_on || by_scattering || map.is_some() {
                let [u, v, next @ ..] = path.numbers.direction(bounce).map(f64::from);
                let lobe = match hit.shade.specular {
                    Some(_) => path.numbers.lobe(bounce).into(),
                    None => 0.0,
                };
                after = next;
                scatter = Some(hit.shade.sample([u, v, lobe], epsilon));
            }
            let along = match &scatter {
                Some(s) if by_scattering => Some(s.direction),
                _ => None,
            };
            let light = self.connect::<KEEP>(finders, path, &hit, emitter, along, work);
            emitter = after;
            let light = match (map, &scatter) {
                (Some(map), Some(scatter)) => {
                    let drawn = path.numbers.environment(bounce).map(f64::from);
                    let along = scatter.direction;
                    light + self.gather::<KEEP>(finders, path, &hit, map, (drawn, along), work)
                }
                _ => light,
            };
            path.bring::<KEEP>(bounce, throughput * light, work);
            let Some(scatter) = scatter.filter(|_| goes_on) else {
                return;
            };
            let triangle = hit.triangle;
            origin = hit.position;
            direction = scatter.direction;
            throughput *= scatter.weight;
            let mut next = Next {
                scatter,
                survival: 1.0,
                end: None,
            };
            let mut ended = last;
            if last {
                if let Some(sky) = sky {
                    let end = self.weigh::<KEEP>(
                        finders,
                        path,
                        (origin, direction),
                        Some(triangle),
                        work,
                    );
                    let light = throughput * sky.at(direction) * end.background;
                    path.bring::<KEEP>(bounce, light, work);
                    next.end = Some(end);
                }
            } else if settings.roulette_after.is_some_and(|after| bounce >= after) {
                next.survival = throughput.max_element().clamp(0.05, 1.0);
                throughput /= next.survival;
                ended = f64::from(path.numbers.roulette(bounce)) >= next.survival;
            }
            if KEEP && let Some(vertex) = work.vertices.last_mut() {
                vertex.next = Some(next);
            }
            if ended {
                return;
            }
            work.census.bounces[bounce as usize + 1] += 1;
            let found =
                self.weigh::<KEEP>(finders, path, (origin, direction), Some(triangle), work);
            let random = || f64::from(path.numbers.surface(bounce + 1));
            drawn = self.draw(&found, random, work);
            ray = Some(found);
        }
    }

    /// The point of a drawn surface.
    #[inline(always)]
    fn hit(&self, surface: usize, origin: DVec3, direction: DVec3, work: &Work) -> Hit {
        let s = &work.surfaces[surface];
        let triangle = &self.hierarchy.triangles[s.triangle as usize];
        let material = self.scene.topology.material[s.triangle as usize];
        let m = material as usize;
        let host = &self.tables.host;
        let geometric = triangle.normal * s.side();
        let attributes = Place::of(s, geometric).attributes(host);
        Hit {
            surface,
            triangle: s.triangle,
            material,
            uv: attributes.uv,
            position: origin + direction * s.t,
            shade: Shade {
                geometric,
                normal: attributes.normal.unwrap_or(geometric),
                diffuse: host.diffuse.at(m, attributes.uv),
                specular: match &host.specular {
                    Some((albedo, exponent)) if self.scene.materials.glossy[m] => {
                        Some((albedo.at(m, attributes.uv), exponent[m]))
                    }
                    _ => None,
                },
                incoming: direction,
            },
            smooth: attributes.normal.is_some(),
        }
    }

    /// Light from one point of one emitter, and from those that lie in the direction in which the path
    /// goes on.
    #[inline(always)]
    fn connect<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        hit: &Hit,
        [u, v]: [f64; 2],
        along: Option<DVec3>,
        work: &mut Work,
    ) -> DVec3 {
        let lights = &self.lights;
        let first = work.lit.len();
        let mut sum = DVec3::ZERO;
        if lights.is_empty() {
            return sum;
        }
        let view = (hit.position, path.time);
        let (emitter, chance, u) = lights.choose_one(Some(view), u, &mut work.chances);
        let (b, c) = (u.sqrt() * (1.0 - v), u.sqrt() * v);
        let combined = along.map(|_| false);
        let triangle = lights.triangle(emitter);
        sum += self.arriving::<KEEP>(finders, path, hit, (triangle, b, c, chance), combined, work);
        if let Some(direction) = along {
            let mut met = std::mem::take(&mut work.met);
            met.clear();
            let range = (self.t_min(), self.grazing());
            lights.meet_one(view, direction, range, |k, b, c| met.push((k, b, c)));
            for &(k, b, c) in &met {
                let chance = lights.chance_of(view, k, &mut work.chances);
                let point = (lights.triangle(k), b, c, chance);
                sum += self.arriving::<KEEP>(finders, path, hit, point, Some(true), work);
            }
            work.met = met;
        }
        if KEEP && let Some(vertex) = work.vertices.last_mut() {
            vertex.lit = first..work.lit.len();
        }
        sum
    }

    fn grazing(&self) -> f64 {
        crate::visibility::grazing(self.scene.context.dtype)
    }

    /// Light of a map along a direction drawn from it and along that in which the path goes on.
    #[inline(never)]
    fn gather<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        hit: &Hit,
        map: &SkyMap,
        ([u, v], along): ([f64; 2], DVec3),
        work: &mut Work,
    ) -> DVec3 {
        let first = work.gathered.len();
        let mut sum = DVec3::ZERO;
        let (drawn, chance) = map.choose_one(u, v);
        for (by_scattering, direction, chance) in
            [(false, drawn, chance), (true, along, map.density(along))]
        {
            let reflected = hit.shade.scattered(direction);
            if reflected == DVec3::ZERO {
                continue;
            }
            let from = Some(hit.triangle);
            let ray = self.weigh::<KEEP>(finders, path, (hit.position, direction), from, work);
            let other = hit.shade.density(direction);
            let density = power_heuristic(chance, other, by_scattering);
            sum += reflected * map.at(direction) * (ray.background / density);
            work.gathered.push(Gathered { ray, density });
        }
        if KEEP && let Some(vertex) = work.vertices.last_mut() {
            vertex.gathered = first..work.gathered.len();
        }
        sum
    }

    /// The way from a surface point to a point of an emitter.
    #[inline(always)]
    pub(super) fn connection(
        &self,
        time: f64,
        position: DVec3,
        emitter: u32,
        corners: [f64; 3],
    ) -> Connection {
        let triangle = &self.hierarchy.triangles[emitter as usize];
        let to = triangle.point(corners) + triangle.velocity * time - position;
        let (squared, least) = (to.length_squared(), self.t_min().powi(2));
        let held = squared < least;
        let squared = squared.max(least);
        let distance = squared.sqrt();
        let direction = to * distance.recip();
        Connection {
            direction,
            squared,
            distance,
            held,
            facing: (-triangle.normal.dot(direction)).max(0.0),
            area: triangle.area(),
        }
    }

    /// Light from a point of an emitter over its density. `combined` says by which of two strategies
    /// it was found, if there are two.
    #[inline(always)]
    fn arriving<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        hit: &Hit,
        (emitter, b, c, chance): (u32, f64, f64, f64),
        combined: Option<bool>,
        work: &mut Work,
    ) -> DVec3 {
        let corners = [1.0 - b - c, b, c];
        let way = self.connection(path.time, hit.position, emitter, corners);
        let reflected = hit.shade.scattered(way.direction);
        if way.facing == 0.0 || reflected == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let ray = HostRay {
            origin: hit.position,
            direction: way.direction,
            time: path.time,
            departure: Some(hit.triangle),
            emitter: Some(emitter),
            distance: Some(way.distance),
        };
        let first = work.shadows.len();
        let offered = work
            .log
            .meet(&finders.shadows, &ray, Span::NONE, &mut work.shadows);
        if !KEEP {
            work.census.tested += u64::from(offered);
            work.census.rays += 1;
        }
        let passed = finders
            .shadows
            .pass(&mut work.shadows[first..], &mut work.passing);
        let per_area = way.facing / way.squared * way.area;
        let density = match combined {
            Some(by_scattering) => {
                let other = hit.shade.density(way.direction) * per_area;
                power_heuristic(chance, other, by_scattering)
            }
            None => chance,
        };
        let m = self.scene.topology.material[emitter as usize] as usize;
        let light = reflected * self.tables.host.emission[m] * (per_area * passed / density);
        if KEEP {
            work.by_p.extend_from_slice(&work.passing);
            work.lit.push(Lit {
                emitter,
                corners,
                way,
                reflected,
                density,
                passed,
                shadows: first..work.shadows.len(),
            });
        }
        light
    }
}

/// What a sample is divided by where two strategies are combined (`transport/emitters.rs`).
fn power_heuristic(a: f64, b: f64, is_b: bool) -> f64 {
    let own = if is_b { b } else { a };
    (a * a + b * b) / own.max(1e-30)
}
