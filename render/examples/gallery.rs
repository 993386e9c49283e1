//! Draws pictures of both machines into a folder: `cargo run --release --example gallery -- OUT`.
//!
//! Postures are made up; what matters is how they look, and how long a picture takes.

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use rodgym_core::env::Scene;
use rodgym_render::{Painter, drawing};
use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args().nth(1).ok_or("give a folder to write to")?;
    let out = Path::new(&out);
    std::fs::create_dir_all(out)?;
    for (name, film) in
        [("swing", film(swing)), ("fin", film(fin)), ("swim", film(swim)), ("still", film(still))]
    {
        let usual = drawing(&film[0].machine).expect("it is drawn").size;
        for size in [usual, (480, 480), (960, 540), (84, 84)] {
            let mut painter = Painter::default();
            let mut best = Duration::MAX;
            let mut rgb = vec![];
            for scene in &film {
                let start = Instant::now();
                rgb = painter.render(scene, size)?;
                best = best.min(start.elapsed());
            }
            let path = out.join(format!("{name}-{}x{}.png", size.0, size.1));
            write(&path, &rgb, size)?;
            println!("{}: {best:?}", path.display());
        }
        let svg = rodgym_render::render_svg(&film[film.len() - 1], usual)?;
        std::fs::write(out.join(format!("{name}.svg")), svg)?;
    }
    Ok(())
}

fn film(scene: fn(f64) -> Scene) -> Vec<Scene> {
    (0..120)
        .map(|step| Scene { steps: step, time: 0.04 * f64::from(step), ..scene(f64::from(step)) })
        .collect()
}

/// A whip-like swing to the side.
fn swing(step: f64) -> Scene {
    let bend = |i: f64| 0.35 * (0.06 * step - 0.9 * i).sin();
    let angles: Vec<f64> = (0..6).map(|i| 0.02 * step + bend(f64::from(i))).collect();
    scenes::pendulum(&angles, 0.05 * (0.05 * step).sin())
}

/// Standing still and nearly straight, without torque.
fn still(_: f64) -> Scene {
    scenes::pendulum(&[3.05, 3.1, 3.18, 3.2, 3.16, 3.12], 0.0)
}

/// A wave that runs down the fin at 1.5 Hz.
fn fin(step: f64) -> Scene {
    let phase = std::f64::consts::TAU * 1.5 * 0.04 * step;
    let wave = |lag: f64| (0.2 + 0.12 * lag) * (phase - 0.5 * lag).sin();
    let [a, b, c, d] = [1.0, 2.0, 3.0, 4.0].map(wave);
    let pitch = wave(0.0);
    let mut scene = scenes::fin(&[pitch, pitch, pitch, a, b, c, d], 0.0);
    scene.values.insert("demand".into(), 0.08.into());
    scene.values["thrust"] = (0.06 + 0.09 * (2.0 * phase).sin()).into();
    scene.values["pitch_target"] = (0.2 * (phase + 0.6).sin()).into();
    scene
}

/// The same while it tows a hull to the left through water at rest.
fn swim(step: f64) -> Scene {
    let mut scene = fin(step);
    let x = -0.2 * 0.04 * step;
    for node in &mut scene.nodes {
        node[0] += x;
    }
    for (name, value) in [("hull_position", x), ("hull_speed", 0.2), ("flow_speed", 0.0)] {
        scene.values.insert(name.into(), value.into());
    }
    scene
}

fn write(path: &Path, rgb: &[u8], size: (u32, u32)) -> Result<(), Box<dyn Error>> {
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path)?), size.0, size.1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(rgb)?;
    Ok(())
}
