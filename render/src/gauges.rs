//! Readouts around the machine: time, reward, bars, the key of the colours, a trace over time.

use crate::color::{ACTUATOR, Color, FAINT_INK, GAIN, INK, LOSS, WHITE, bend_color};
use crate::past::{MEMORY, Past};
use crate::picture::{Align, Picture, Point};
use crate::text::number;
use rodgym_core::env::Scene;

/// Pictures smaller than this \[px, shorter side\] show the machine only: they are made for agents.
const LEGIBLE: u32 = 160;

/// Sizes of the readouts of one picture.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    /// Font size \[px\].
    pub font: f32,
    /// Distance from the border \[px\].
    pub margin: f32,
    /// Length of bars \[px\].
    pub bar: f32,
}

impl Layout {
    /// Sizes that fit the picture; `None` when text would not be legible.
    pub fn new(picture: &Picture) -> Option<Layout> {
        let short = picture.width.min(picture.height);
        let font = (short as f32 / 35.0).clamp(8.0, 28.0);
        (short >= LEGIBLE).then_some(Layout { font, margin: 1.2 * font, bar: 10.0 * font })
    }

    /// Height of a line of text \[px\].
    pub fn line(&self) -> f32 {
        1.45 * self.font
    }
}

/// A caption with a value beside it, within the width of a bar; `left` is the caption's start.
pub(crate) fn reading(
    picture: &mut Picture,
    layout: Layout,
    (left, baseline): Point,
    caption: &str,
    value: &str,
) {
    picture.text((left, baseline), layout.font, Align::Left, FAINT_INK, caption);
    picture.text((left + layout.bar, baseline), layout.font, Align::Right, INK, value);
}

/// Time and step, upper left.
pub(crate) fn clock(picture: &mut Picture, layout: Layout, scene: &Scene) {
    let at = (layout.margin, layout.margin + layout.font);
    let time = format!("{} s", number(scene.time, 2));
    picture.text(at, 1.45 * layout.font, Align::Left, INK, &time);
    let below = (at.0, at.1 + layout.line());
    picture.text(below, layout.font, Align::Left, FAINT_INK, &format!("step {}", scene.steps));
}

/// Reward of the last step as a bar and the episode's return, upper right.
pub(crate) fn reward(picture: &mut Picture, layout: Layout, scene: &Scene) {
    let left = picture.extent().0 - layout.margin - layout.bar;
    let top = layout.margin + layout.font;
    reading(picture, layout, (left, top), "return", &number(scene.episode_return, 1));
    let below = top + layout.line();
    reading(picture, layout, (left, below), "reward", &number(scene.reward, 2));
    let color = if scene.reward < 0.0 { LOSS } else { GAIN };
    bar(picture, layout, (left, below + 0.5 * layout.font), scene.reward, color);
}

/// A bar from its middle, `fraction` in \[-1, 1\]; `at` is its upper left corner.
pub(crate) fn bar(
    picture: &mut Picture,
    layout: Layout,
    (left, top): Point,
    fraction: f64,
    color: Color,
) {
    let thick = 0.42 * layout.font;
    let (right, middle) = (left + layout.bar, left + layout.bar / 2.0);
    picture.slab((left, top), (right, top + thick), thick / 2.0, INK.alpha(0.12));
    let fraction = if fraction.is_nan() { 0.0 } else { fraction.clamp(-1.0, 1.0) as f32 };
    let tip = middle + fraction * layout.bar / 2.0;
    if (tip - middle).abs() > 0.3 {
        picture.slab((middle, top), (tip, top + thick), thick / 2.0, color);
    }
    picture.line(&[(middle, top - 1.5), (middle, top + thick + 1.5)], 1.2, FAINT_INK);
}

/// The key of the rod's colours; `at` is its lower left corner.
pub(crate) fn bend_key(picture: &mut Picture, layout: Layout, (left, bottom): Point) {
    let thick = 0.42 * layout.font;
    // Whole pixels, so that no seam shows between the cells.
    let edge = |i: i32| (left + layout.bar * i as f32 / 25.0).round();
    let (top, low) = ((bottom - thick).round(), bottom.round());
    for i in 0..25 {
        picture.slab((edge(i), top), (edge(i + 1), low), 0.0, bend_color(2 * i - 24));
    }
    let baseline = bottom - thick - 0.55 * layout.font;
    let at = (left + layout.bar / 2.0, baseline);
    picture.text(at, layout.font, Align::Center, FAINT_INK, "bend");
    picture.text((left, baseline), layout.font, Align::Left, FAINT_INK, "\u{2212}");
    picture.text((left + layout.bar, baseline), layout.font, Align::Right, FAINT_INK, "+");
}

/// Thrust that an axis always has room for \[N\]: about the most that a fin of the defaults gives, so that the axis
/// is the same from picture to picture.
const USUAL_THRUST: f64 = 0.5;

/// Thrust over the remembered steps, the present at the right, and the thrust that is demanded \[N\], in the
/// rectangle from `low` to `high`.
pub(crate) fn thrust_trace(
    picture: &mut Picture,
    layout: Layout,
    (low, high): (Point, Point),
    past: &Past,
    demand: Option<f64>,
) {
    panel(picture, layout, low, high);
    let pad = 0.7 * layout.font;
    let small = 0.85 * layout.font;
    let (left, right) = (low.0 + pad + 6.2 * small, high.0 - pad);
    let values = past.moments.iter().filter_map(|m| Some((m.step, m.thrust?)));
    let all = || values.clone().map(|(_, v)| v).chain(demand);
    let top = round_up(all().fold(USUAL_THRUST, f64::max));
    let bottom = round_up(all().fold(0.0, |m, v| m.max(-v))).max(0.2 * top);
    let scale = (high.1 - low.1 - 2.0 * pad) / (top + bottom) as f32;
    let y = |v: f64| low.1 + pad + (top - v) as f32 * scale;
    let now = past.moments.back().map_or(0, |m| m.step);
    // A fixed window: the trace moves at the same speed in every episode.
    let step = (right - left) / (MEMORY - 1) as f32;
    let x = |k: u32| right - step * (now - k) as f32;
    let points: Vec<Point> = values.clone().map(|(k, v)| (x(k), y(v))).collect();
    picture.dashed(&[(left, y(0.0)), (right, y(0.0))], 1.0, 4.0, FAINT_INK.alpha(0.7));
    if let Some(demand) = demand {
        let ends = [(left, y(demand)), (right, y(demand))];
        picture.dashed(&ends, 0.1 * layout.font, 6.0, ACTUATOR.alpha(0.8));
    }
    if let (Some(first), Some(last)) = (points.first(), points.last()) {
        let mut area = points.clone();
        area.extend([(last.0, y(0.0)), (first.0, y(0.0))]);
        picture.polygon(&area, GAIN.alpha(0.16));
        picture.line(&points, 0.12 * layout.font, GAIN);
        picture.disc(*last, 0.28 * layout.font, GAIN);
    }
    let mut label = |baseline: f32, text: &str| {
        picture.text((low.0 + pad, baseline), small, Align::Left, FAINT_INK, text);
    };
    label(low.1 + pad + 0.7 * small, "thrust");
    label(low.1 + pad + 2.1 * small, &format!("to {} mN", number(1e3 * top, 0)));
    label(high.1 - pad, &format!("from {}", number(-1e3 * bottom, 0)));
}

/// A pale ground for readouts that would else lie on a busy one.
pub(crate) fn panel(picture: &mut Picture, layout: Layout, low: Point, high: Point) {
    picture.slab(low, high, 0.6 * layout.font, WHITE.alpha(0.62));
}

/// The next of 1, 2, 5, 10, 20, ... times 0.01: a scale that seldom changes.
fn round_up(value: f64) -> f64 {
    let mut scale = 0.01;
    for factor in [2.0, 2.5, 2.0].into_iter().cycle().take(60) {
        if scale >= value * (1.0 - 1e-9) {
            break;
        }
        scale *= factor;
    }
    scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_of_a_trace_holds_its_values_and_is_round() {
        for (value, scale) in [(0.003, 0.01), (0.05, 0.05), (0.051, 0.1), (0.12, 0.2), (3.0, 5.0)] {
            assert!((round_up(value) / scale - 1.0).abs() < 1e-9, "{value}");
        }
        assert!(round_up(1e300).is_finite());
    }
}
