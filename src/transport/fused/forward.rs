//! Paths of one pixel from the camera on.

use glam::DVec3;

use super::records::{Branch, CameraRay, Connection, Gathered, Hit, Lit, Next, Ray, Vertex, Work};
use super::shading::{Shade, sin_cos_of_turns};
use super::surface::Place;
use super::{Finders, Fused, Pixel};
use crate::transport::SurfaceSampling;
use crate::transport::sampler::{Numbers, RUN};
use crate::transport::sky::SkyMap;
use crate::transport::tracer::SPLIT;
use crate::visibility::{HostRay, Span, Surface};

/// What stays the same along a path.
struct Path<'a> {
    numbers: Numbers<'a>,
    time: f64,
    /// Where its light is added.
    slot: usize,
    /// Random numbers for the first emitter.
    emitter: [f64; 2],
}

impl Path<'_> {
    /// Adds light that it brought back after some bounces.
    #[inline(always)]
    fn bring<const KEEP: bool>(&self, bounce: u32, light: DVec3, work: &mut Work) {
        if KEEP {
            work.light[self.slot + bounce as usize] += light;
        } else {
            work.brought += light;
        }
    }
}

impl Fused {
    /// The sum over a pixel's samples. With `KEEP` all that they met stays in `work`.
    #[inline(always)]
    pub(super) fn pixel<const KEEP: bool>(
        &self,
        finders: &Finders,
        pixel: u32,
        (from, to): (u32, u32),
        work: &mut Work,
    ) -> Pixel {
        let mut sum = Pixel::default();
        let mut first = from - from % RUN as u32;
        while first < to {
            let past = first + RUN as u32;
            let run = self.sampler.run(pixel, first..past, self.drawn);
            for sample in first.max(from)..past.min(to) {
                let slot = work.light.len();
                if KEEP {
                    work.light.resize(slot + work.bounces + 1, DVec3::ZERO);
                }
                work.brought = DVec3::ZERO;
                let seen = self.sample::<KEEP>(finders, run.numbers(sample), pixel, slot, work);
                sum.radiance += seen.radiance + work.brought;
                sum.opacity += seen.opacity;
                sum.depth += seen.depth;
                sum.normal += seen.normal;
                if !KEEP {
                    work.forget();
                }
            }
            first = past;
        }
        sum
    }

    /// One camera ray and its paths; returns what it sees of emitters and environment.
    #[inline(always)]
    fn sample<const KEEP: bool>(
        &self,
        finders: &Finders,
        numbers: Numbers,
        pixel: u32,
        slot: usize,
        work: &mut Work,
    ) -> Pixel {
        let mut camera = self.camera_ray(&numbers, pixel);
        let path = Path {
            time: camera.time,
            numbers,
            slot,
            emitter: camera.emitter,
        };
        let (origin, direction) = (camera.ray.origin, camera.ray.direction);
        camera.ray = self.weigh::<KEEP>(finders, &path, (origin, direction), None, work);
        work.census.bounces[0] += 1;
        let seen = self.seen(&camera.ray, work);
        let first = work.branches.len();
        if !self.scene.emitters.is_empty() || self.tables.host.sky.is_some() {
            let split = self.settings.sampling.surfaces == SurfaceSampling::Split;
            let random = || path.numbers.surface(0);
            let mut entries = std::mem::take(&mut work.entries);
            entries.clear();
            if split {
                self.split(&camera.ray, random, work, &mut entries);
            } else {
                entries.push((self.draw(&camera.ray, random, work), 1.0));
            }
            for &(drawn, share) in &entries {
                let begin = work.vertices.len();
                let useful = drawn.is_some_and(|s| self.useful(work.surfaces[s].triangle));
                if useful {
                    self.walk::<KEEP>(finders, &path, &camera.ray, drawn, share, work);
                } else if split {
                    continue;
                }
                if KEEP {
                    work.branches.push(Branch {
                        drawn,
                        alone: !split,
                        share,
                        vertices: begin..work.vertices.len(),
                    });
                }
            }
            work.entries = entries;
        }
        if KEEP {
            camera.branches = first..work.branches.len();
            work.cameras.push(camera);
        }
        seen
    }

    /// Black surfaces end a path.
    fn useful(&self, triangle: u32) -> bool {
        let material = self.scene.topology.material[triangle as usize];
        self.scene.materials.reflects[material as usize]
    }

    #[inline(always)]
    fn camera_ray(&self, numbers: &Numbers, pixel: u32) -> CameraRay {
        let c = &self.camera;
        let [width, height] = self.size;
        let [x, y, u, v] = numbers.film();
        let x = (f64::from(pixel % width as u32) + x) / width as f64;
        let y = (f64::from(pixel / width as u32) + y) / height as f64;
        let film = [
            (2.0 * x - 1.0) * (width as f64 / height as f64),
            1.0 - 2.0 * y,
        ];
        let through = (c.right * film[0] + c.up * film[1]) * c.half_height + c.forward;
        let mut disk = [0.0; 2];
        let (origin, along) = match c.lens {
            Some([aperture, focus]) => {
                let [radius, angle] = numbers.lens();
                let (sin, cos) = sin_cos_of_turns(angle);
                disk = [radius.sqrt() * cos, radius.sqrt() * sin];
                let on_lens = (c.right * disk[0] + c.up * disk[1]) * aperture;
                (c.eye + on_lens, through * focus - on_lens)
            }
            None => (c.eye, through),
        };
        let length = along.length();
        CameraRay {
            ray: Ray {
                origin,
                direction: along * length.recip(),
                surfaces: 0..0,
                background: 1.0,
                depth: 1.0,
            },
            time: if self.tables.host.moves {
                numbers.time()
            } else {
                0.0
            },
            film,
            disk,
            length,
            emitter: [u, v],
            branches: 0..0,
        }
    }

    /// A camera or bounce ray with its surfaces.
    #[inline(always)]
    fn weigh<const KEEP: bool>(
        &self,
        finders: &Finders,
        path: &Path,
        (origin, direction): (DVec3, DVec3),
        departure: Option<u32>,
        work: &mut Work,
    ) -> Ray {
        let span = self.span(origin);
        let ray = HostRay {
            origin,
            direction,
            time: path.time,
            departure,
            emitter: None,
            distance: None,
        };
        let first = work.surfaces.len();
        let offered = work.log.meet(&finders.rays, &ray, span, &mut work.surfaces);
        let background = finders.rays.weigh(span, &mut work.surfaces, first);
        if !KEEP {
            let count = work.surfaces.len() - first;
            work.census.add_ray(u64::from(offered), count);
        }
        Ray {
            origin,
            direction,
            surfaces: first..work.surfaces.len(),
            background,
            depth: span.depth(),
        }
    }

    /// Emission on fronts and environment, weighted, and what else a camera ray sees.
    #[inline(always)]
    fn seen(&self, ray: &Ray, work: &mut Work) -> Pixel {
        let sky = self.tables.host.sky.as_ref();
        let sky = sky.map_or(DVec3::ZERO, |sky| sky.at(ray.direction));
        let mut seen = Pixel {
            radiance: sky * ray.background,
            opacity: 1.0 - ray.background,
            ..Pixel::default()
        };
        for s in &work.surfaces[ray.surfaces.clone()] {
            let side = s.side() * s.weight;
            seen.radiance += self.emission(s) * s.weight;
            seen.depth += s.weight * s.t;
            seen.normal += self.hierarchy.triangles[s.triangle as usize].normal * side;
        }
        if let Some(objects) = &mut work.objects {
            for s in &work.surfaces[ray.surfaces.clone()] {
                objects[self.scene.topology.object[s.triangle as usize] as usize] += s.weight;
            }
            if let Some(last) = objects.last_mut() {
                *last += ray.background;
            }
        }
        seen
    }

    /// What a surface sends back along a ray.
    pub(super) fn emission(&self, s: &Surface) -> DVec3 {
        let m = self.scene.topology.material[s.triangle as usize] as usize;
        if s.cosine < 0.0 && self.scene.materials.emits[m] {
            self.tables.host.emission[m]
        } else {
            DVec3::ZERO
        }
    }

    /// Surfaces with their weights in order of triangles, the background last.
    fn ordered(&self, ray: &Ray, work: &mut Work) -> f64 {
        let surfaces = ray.surfaces.clone();
        work.order.clear();
        for i in surfaces {
            let s = &work.surfaces[i];
            work.order.push((s.triangle, Some(i), s.weight));
        }
        work.order.sort_unstable_by_key(|s| s.0);
        let total = work.order.iter().map(|s| s.2).sum::<f64>() + ray.background;
        work.order.push((u32::MAX, None, ray.background));
        total
    }

    /// One surface, drawn with its weight.
    #[inline(always)]
    fn draw(&self, ray: &Ray, random: impl Fn() -> f64, work: &mut Work) -> Option<usize> {
        if ray.surfaces.len() == 1 && ray.background <= 0.0 {
            return Some(ray.surfaces.start);
        }
        let threshold = self.ordered(ray, work) * random();
        let mut passed = 0.0;
        for &(_, surface, weight) in &work.order {
            passed += weight;
            if passed > threshold {
                return surface;
            }
        }
        None
    }

    /// Several surfaces, each with its weight over its probability.
    #[inline(always)]
    fn split(
        &self,
        ray: &Ray,
        random: impl Fn() -> f64,
        work: &mut Work,
        entries: &mut Vec<(Option<usize>, f64)>,
    ) {
        if ray.surfaces.len() == 1 && ray.background <= 0.0 {
            let first = ray.surfaces.start;
            entries.push((Some(first), work.surfaces[first].weight));
            return;
        }
        let least = 1.0 / SPLIT as f64;
        let total = self.ordered(ray, work);
        // The next number of the comb u, u + 1, … over cumulative weights in units of 1/draws.
        let (mut passed, mut next) = (0.0, total * random() * least);
        for &(_, surface, weight) in &work.order {
            passed += weight;
            if passed > next {
                entries.push((surface, weight.max(least)));
                while passed > next {
                    next += total * least;
                }
            }
        }
    }

    /// Follows a path from a surface of a camera ray on.
    #[inline(always)]
    fn walk<const KEEP: bool>(
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
                if let (Some(sky), None) = (self.missed(), drawn) {
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
                let [u, v, next @ ..] = path.numbers.direction(bounce);
                let lobe = match hit.shade.specular {
                    Some(_) => path.numbers.lobe(bounce),
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
                    let drawn = path.numbers.environment(bounce);
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
                ended = path.numbers.roulette(bounce) >= next.survival;
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
            let random = || path.numbers.surface(bounce + 1);
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
