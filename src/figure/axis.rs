//! Axes: ranges, ticks and labels.

use super::text::Font;

/// One axis of a plot. A logarithmic axis stores decimal logarithms.
pub(super) struct Axis {
    log: bool,
    from: f64,
    to: f64,
    /// The positions and labels of ticks.
    pub ticks: Vec<(f64, String)>,
    /// The positions of minor ticks, without labels.
    pub minor: Vec<f64>,
}

impl Axis {
    /// Makes an axis around the finite values; `padding` is a fraction of their range.
    pub fn around(values: impl Iterator<Item = f64>, log: bool, padding: f64) -> Self {
        let values = values
            .map(|v| if log { v.log10() } else { v })
            .filter(|v| v.is_finite());
        let (mut from, mut to) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
        if from > to {
            (from, to) = if log { (-1.0, 0.0) } else { (0.0, 1.0) };
        }
        let range = to - from;
        let room = if range > 1e-12 * from.abs().max(to.abs()) {
            padding * range
        } else if log || from == 0.0 {
            0.5
        } else {
            0.1 * from.abs()
        };
        Self {
            log,
            from: from - room,
            to: to + room,
            ticks: Vec::new(),
            minor: Vec::new(),
        }
    }

    /// Places about `count` ticks.
    pub fn divide(mut self, count: usize) -> Self {
        if self.log {
            self.divide_log(count);
        } else {
            let (step, values) = round_values(self.from, self.to, count);
            self.ticks = labeled(step, &values);
        }
        self
    }

    fn divide_log(&mut self, count: usize) {
        let (from, to) = (self.from, self.to);
        let place = |mantissa: u32, power: i32| f64::from(mantissa).log10() + f64::from(power);
        let inside = |&(m, p): &(u32, i32)| (from..=to).contains(&place(m, p));
        let powers = from.floor() as i32..=to.floor() as i32;
        let all: Vec<(u32, i32)> = powers
            .flat_map(|p| (1..10).map(move |m| (m, p)))
            .filter(inside)
            .collect();
        let decades = all.iter().filter(|(m, _)| *m == 1).count();
        let few = all.iter().filter(|(m, _)| [1, 2, 5].contains(m)).count();
        let chosen = |m: u32, p: i32| {
            if decades > count {
                m == 1 && p.rem_euclid(decades.div_ceil(count) as i32) == 0
            } else if decades > 2 {
                m == 1
            } else {
                [1, 2, 5].contains(&m)
            }
        };
        if few < 3 {
            let (step, values) = round_values(10f64.powf(from), 10f64.powf(to), count);
            let logarithm = |(v, label): (f64, String)| (v.log10(), label);
            self.ticks = labeled(step, &values).into_iter().map(logarithm).collect();
            return;
        }
        let (ticks, minor): (Vec<_>, Vec<_>) = all.into_iter().partition(|&(m, p)| chosen(m, p));
        let plain = ticks.iter().all(|&(_, p)| (-2..=2).contains(&p));
        let label = |m: u32, p: i32| {
            if plain {
                decimal(f64::from(m) * 10f64.powi(p), (-p).max(0) as usize)
            } else {
                power_of_ten(&m.to_string(), p)
            }
        };
        let tick = |&(m, p): &(u32, i32)| (place(m, p), label(m, p));
        self.ticks = ticks.iter().map(tick).collect();
        if decades <= count {
            self.minor = minor.iter().map(|&(m, p)| place(m, p)).collect();
        }
    }

    /// The width of the widest label.
    pub fn widest(&self, font: &Font, size: f64) -> f64 {
        let widths = self.ticks.iter().map(|tick| font.width(&tick.1, size));
        widths.fold(0.0, f64::max)
    }

    /// Maps a position on the axis to [0, 1] between its ends.
    pub fn share(&self, place: f64) -> f64 {
        (place - self.from) / (self.to - self.from)
    }

    /// Maps a value to [0, 1] between the ends of the axis; `None` if it can't be shown.
    pub fn share_of(&self, value: f64) -> Option<f64> {
        let share = self.share(if self.log { value.log10() } else { value });
        share.is_finite().then_some(share)
    }
}

/// Returns a step (1, 2 or 5 times a power of ten) and its multiples in the range, about `count` of them.
fn round_values(from: f64, to: f64, count: usize) -> (f64, Vec<f64>) {
    let raw = (to - from) / count.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|m| m * power);
    let step = steps
        .into_iter()
        .find(|&s| s >= raw)
        .unwrap_or(10.0 * power);
    let (first, last) = ((from / step - 1e-9).ceil(), (to / step + 1e-9).floor());
    let values = (first as i64..=last as i64).map(|k| k as f64 * step);
    (step, values.collect())
}

fn labeled(step: f64, values: &[f64]) -> Vec<(f64, String)> {
    let most = values.iter().fold(0f64, |m, v| m.max(v.abs()));
    let decimals = (-step.log10() - 1e-9).ceil().max(0.0) as usize;
    let plain = most < 1e5 && (most >= 1e-2 && decimals < 5);
    let label = |v: f64| match format!("{v:.9e}").split_once('e') {
        Some((mantissa, power)) if !plain && v != 0.0 => {
            let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.');
            power_of_ten(mantissa, power.parse().unwrap_or(0))
        }
        _ => decimal(v, if v == 0.0 && !plain { 0 } else { decimals }),
    };
    values.iter().map(|&v| (v, label(v))).collect()
}

fn decimal(v: f64, decimals: usize) -> String {
    format!("{v:.decimals$}").replace('-', "−")
}

/// Formats a number, such as 2·10⁻³.
fn power_of_ten(mantissa: &str, power: i32) -> String {
    let raised = |c: char| match c.to_digit(10) {
        Some(d) => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][d as usize],
        None => '⁻',
    };
    let power: String = power.to_string().chars().map(raised).collect();
    match mantissa {
        "1" => format!("10{power}"),
        "-1" => format!("−10{power}"),
        _ => format!("{}·10{power}", mantissa.replace('-', "−")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks are between the ends, their labels are unique, and their number is about as requested.
    #[test]
    fn ticks_tell_places_apart() {
        for (from, to) in [
            (0.0, 1.0),
            (-3.0, 7.0),
            (1e-9, 3e-9),
            (0.03, 4e5),
            (100.0, 100.5),
            (2.0, 2.0),
            (1e12, 3e12),
            (1.0, 1.0 + 1e-7),
        ] {
            for log in [false, true] {
                for count in [2, 4, 9] {
                    let axis = Axis::around([from, to].into_iter(), log, 0.0).divide(count);
                    let ticks = &axis.ticks;
                    let case = format!("{from} to {to}, {log}, {count}: {ticks:?}");
                    let inside = |p: f64| (-1e-6..=1.0 + 1e-6).contains(&axis.share(p));
                    assert!(ticks.iter().all(|t| inside(t.0)), "{case}");
                    let mut labels: Vec<&String> = ticks.iter().map(|t| &t.1).collect();
                    labels.sort();
                    labels.dedup();
                    assert_eq!(labels.len(), ticks.len(), "{case}");
                    assert!((1..=3 * count + 3).contains(&ticks.len()), "{case}");
                }
            }
        }
        let labels = |axis: Axis| axis.ticks.into_iter().map(|t| t.1).collect::<Vec<_>>();
        let axis = Axis::around([-1.0, 1.0].into_iter(), false, 0.0).divide(4);
        assert_eq!(labels(axis), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        let axis = Axis::around([1e-4, 1.0].into_iter(), true, 0.0).divide(8);
        assert_eq!(labels(axis), ["10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]);
    }
}
