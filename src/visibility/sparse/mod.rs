//! The same weights and transmittances from the triangles that can matter to each ray only. Values
//! and derivatives are computed on the host, in f64, ray by ray; into the graph goes one linear
//! term: Σ coefficient·(vertex, origin, direction, velocity). The tensor program in the rest of this
//! folder is the specification.

mod finder;
mod ray;
mod terms;
mod weights;

use burn::tensor::Tensor;
use rayon::prelude::*;

use super::{CoverageSettings, DepthRange, Rays, Softmax, Span};
use crate::error::Result;
use crate::geometry::{Context, Topology, host_values};
use finder::Finder;
use ray::{HostRays, Lists, Surface, pieces};
use terms::Terms;
pub(crate) use terms::{Sparse, hierarchy_of};
pub(crate) use weights::SparseWeights;
use weights::passed;

impl Sparse {
    fn finder<'a>(
        &'a self,
        context: &Context,
        topology: &'a Topology,
        settings: &CoverageSettings,
        form: Softmax,
    ) -> Finder<'a> {
        Finder::new(
            &self.hierarchy,
            topology,
            context,
            settings,
            form,
            self.cutoff,
        )
    }

    /// The weights of all surfaces of each ray.
    pub fn weights(
        &self,
        context: &Context,
        topology: &Topology,
        rays: &Rays,
        settings: &CoverageSettings,
        form: Softmax,
        range: DepthRange,
    ) -> Result<SparseWeights<'_>> {
        let host = HostRays::new(rays)?;
        let (near, far) = (host_values(&range.near)?, host_values(&range.far)?);
        let spans = near.iter().zip(&far);
        let spans: Vec<Span> = spans.map(|(&near, &far)| Span { near, far }).collect();
        let finder = self.finder(context, topology, settings, form);
        let n = host.origin.len();
        let parts: Vec<(Lists<Surface>, Vec<f64>, u64)> = pieces(n)
            .into_par_iter()
            .map(|range| {
                let mut lists = Lists::default();
                let (mut background, mut offered) = (Vec::new(), 0);
                let mut found = Vec::new();
                for i in range {
                    found.clear();
                    let ray = host.ray(rays, i);
                    offered += u64::from(finder.intersect(&ray, Some(spans[i]), &mut found));
                    background.push(finder.weigh(spans[i], &mut found));
                    lists.push(&found);
                }
                (lists, background, offered)
            })
            .collect();
        let mut surfaces = Lists::default();
        let (mut background, mut offered) = (Vec::with_capacity(n), 0);
        for (part, b, o) in parts {
            surfaces.join(part);
            background.extend(b);
            offered += o;
        }
        Ok(SparseWeights {
            sparse: self,
            context: context.clone(),
            tracked: self.is_tracked(rays),
            rays: rays.clone(),
            host,
            surfaces,
            background,
            form,
            range,
            spans,
            triangles: topology.object.len() as u32,
            offered,
        })
    }

    /// The share of light that arrives along shadow rays `[1, N]`, in the graph if a gradient can
    /// flow; and how many candidates the hierarchy offered. Rays that are not needed are not traced:
    /// 0.
    pub fn transmittance(
        &self,
        context: &Context,
        topology: &Topology,
        rays: &Rays,
        settings: &CoverageSettings,
        form: Softmax,
        needed: &[bool],
    ) -> Result<(Tensor<2>, u64)> {
        let host = HostRays::new(rays)?;
        let n = host.origin.len();
        let tracked = self.is_tracked(rays);
        let finder = self.finder(context, topology, settings, form);
        let parts: Vec<(Vec<f64>, Terms, u64)> = pieces(n)
            .into_par_iter()
            .map(|range| {
                let (mut values, mut terms, mut offered) = (Vec::new(), Terms::default(), 0);
                let mut found = Vec::new();
                let mut by_p = Vec::new();
                for i in range {
                    found.clear();
                    if tracked {
                        terms.begin_ray();
                    }
                    if !needed[i] {
                        values.push(0.0);
                        continue;
                    }
                    let ray = host.ray(rays, i);
                    offered += u64::from(finder.intersect(&ray, None, &mut found));
                    let value = passed(&found, &mut by_p);
                    values.push(value);
                    if tracked {
                        for (s, g) in found.iter().zip(&by_p) {
                            terms.add(self, &host, i, s, g * s.slope, g * s.slope_t, self.cutoff);
                        }
                    }
                }
                (values, terms, offered)
            })
            .collect();
        let mut values = Vec::with_capacity(n);
        let (mut terms, mut offered) = (Terms::default(), 0);
        for (v, t, o) in parts {
            values.extend(v);
            terms.join(t);
            offered += o;
        }
        let value = context.row(&values);
        let value = match terms.row(self, context, rays, n) {
            Some(change) if tracked => value + change,
            _ => value,
        };
        Ok((value, offered))
    }
}
