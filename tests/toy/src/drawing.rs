//! The bead on its spring.

use rodgym_core::env::Scene;
use rodgym_render::Drawing;
use rodgym_render::color::{ACTUATOR, INK, PAPER, PAPER_LOW};
use rodgym_render::past::Past;
use rodgym_render::picture::Picture;
use rodgym_render::view::View;

/// How the bead is drawn.
pub const BEAD: Drawing = Drawing { machine: "bead", size: (480, 160), draw };

fn draw(scene: &Scene, _: &Past, size: (u32, u32)) -> Picture {
    let mut picture = Picture::new(size, [PAPER, PAPER_LOW]);
    let (width, height) = picture.extent();
    let view = View {
        world: [0.0, 0.0],
        pixel: (width / 2.0, height / 2.0),
        scale: f64::from(width) / 6.0,
    };
    let [wall, bead] = [view.at(scene.nodes[0]), view.at(scene.nodes[1])];
    picture.line(&[wall, bead], 3.0, INK);
    picture.disc(bead, 0.1 * height, ACTUATOR);
    picture
}
