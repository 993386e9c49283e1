//! Pictures of rods: antialiased, headless, with no system libraries or fonts.
//!
//! [`render`] gives pixels, [`render_svg`] the same picture as vectors; a [`Painter`] remembers the episode
//! and adds the way of the tip and the thrust over time. What is drawn depends on the scenes and the size
//! only: the same scenes give the same bytes.
//!
//! Of the scene's `values` and `arrows`, pictures use (each may be absent):
//!
//! | machine | name | unit | shown as |
//! |---|---|---|---|
//! | pendulum | `torque`, `torque_limit` | N m | arc about the base, bar |
//! | pendulum | `length` | m | upright ghost, scale |
//! | fin | `pitch`, `pitch_target` | rad | arc, dashed line |
//! | fin | `thrust` | N | arrow, trace |
//! | fin | `demand` | N | dashed line in the trace |
//! | fin | `flow_speed` | m/s | water that passes |
//! | fin | `hull_position`, `hull_speed` | m, m/s | hull, to which the picture keeps |
//! | fin | `fluid_force` (arrows) | N | arrow at each node |

pub mod color;
mod drawings;
mod fin;
mod gauges;
pub mod past;
mod pendulum;
pub mod picture;
mod raster;
pub mod rod;
mod svg;
mod text;
pub mod view;

pub use drawings::{Drawing, drawing, drawings, register};

use past::Past;
use picture::Picture;
use rodgym_core::env::Scene;
use rodgym_core::{Error, Result};

/// Smallest and largest width and height \[px\].
pub const SIZE_LIMITS: (u32, u32) = (16, 8192);

/// Draws a scene: RGB bytes, row-major (height, width, 3); `size` is (width, height) \[px\].
///
/// Below 160 pixels the readouts are left out.
///
/// # Errors
/// A size outside [`SIZE_LIMITS`], a machine that is not known, nodes that are not finite or fewer
/// than two, thickness or curvature of another length than the nodes.
pub fn render(scene: &Scene, size: (u32, u32)) -> Result<Vec<u8>> {
    Painter::default().render(scene, size)
}

/// Draws a scene as a complete SVG document, for figures.
///
/// # Errors
/// As [`render`].
pub fn render_svg(scene: &Scene, size: (u32, u32)) -> Result<String> {
    Painter::default().render_svg(scene, size)
}

/// Draws the scenes of one environment in turn and remembers the last 200 steps of the episode: pictures
/// then show the way of the tip, and of a fin the thrust over time.
#[derive(Clone, Debug, Default)]
pub struct Painter {
    past: Past,
}

impl Painter {
    /// Draws the present scene: RGB bytes, row-major (height, width, 3).
    ///
    /// # Errors
    /// As [`render`]; nothing is remembered then.
    pub fn render(&mut self, scene: &Scene, size: (u32, u32)) -> Result<Vec<u8>> {
        Ok(raster::paint(&self.draw(scene, size)?))
    }

    /// Draws the present scene as an SVG document.
    ///
    /// # Errors
    /// As [`render`]; nothing is remembered then.
    pub fn render_svg(&mut self, scene: &Scene, size: (u32, u32)) -> Result<String> {
        Ok(svg::write(&self.draw(scene, size)?))
    }

    fn draw(&mut self, scene: &Scene, size: (u32, u32)) -> Result<Picture> {
        let (least, most) = SIZE_LIMITS;
        for (name, pixels) in [("width", size.0), ("height", size.1)] {
            if !(least..=most).contains(&pixels) {
                let allowed = format!("from {least} to {most} pixels");
                return Err(Error::parameter(format!("picture {name}"), pixels, allowed));
            }
        }
        view::check(scene)?;
        let drawing = drawing(&scene.machine)?;
        self.past.note(scene);
        Ok((drawing.draw)(scene, &self.past, size))
    }
}
