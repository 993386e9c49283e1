//! Metres to pixels, and the checked contents of a scene.

use crate::picture::Point;
use rodgym_core::env::Scene;
use rodgym_core::{Error, Result};

/// Where the world lies in the picture.
pub struct View {
    /// World point \[m\] that is shown at `pixel`.
    pub world: [f64; 2],
    /// Where `world` is shown \[px\].
    pub pixel: Point,
    /// Pixels a metre.
    pub scale: f64,
}

impl View {
    /// A world point in pixels.
    pub fn at(&self, [x, y]: [f64; 2]) -> Point {
        (
            self.pixel.0 + ((x - self.world[0]) * self.scale) as f32,
            self.pixel.1 - ((y - self.world[1]) * self.scale) as f32,
        )
    }

    /// A world length in pixels.
    pub fn length(&self, metres: f64) -> f32 {
        (metres * self.scale) as f32
    }

    /// Makes the scale smaller until every node lies in the rectangle from `low` to `high` \[px\].
    pub fn hold(&mut self, nodes: &[[f64; 2]], low: Point, high: Point) {
        for [x, y] in nodes {
            let (dx, dy) = (x - self.world[0], self.world[1] - y);
            for (d, room) in [
                (dx, f64::from(high.0 - self.pixel.0)),
                (-dx, f64::from(self.pixel.0 - low.0)),
                (dy, f64::from(high.1 - self.pixel.1)),
                (-dy, f64::from(self.pixel.1 - low.1)),
            ] {
                if d * self.scale > room {
                    self.scale = room / d;
                }
            }
        }
    }
}

/// Refuses a scene that cannot be drawn.
pub fn check(scene: &Scene) -> Result<()> {
    let n = scene.nodes.len();
    let shape = |name: &str, got: usize, expected: String| {
        Err(Error::Shape { name: name.into(), got: format!("({got},)"), expected })
    };
    if n < 2 {
        return shape("scene.nodes", n, "at least 2 nodes".into());
    }
    for (name, values) in
        [("scene.thickness", &scene.thickness), ("scene.curvature", &scene.curvature)]
    {
        if values.len() != n {
            return shape(name, values.len(), format!("({n},), one a node,"));
        }
        if let Some((i, v)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(Error::parameter(format!("{name}[{i}]"), v, "finite"));
        }
    }
    // Beyond a thousand kilometres single-precision pixels mean nothing.
    let far = |v: &f64| v.is_nan() || v.abs() > 1e6;
    match scene.nodes.iter().enumerate().find(|(_, p)| p.iter().any(far)) {
        Some((i, [x, y])) => Err(Error::parameter(
            format!("scene.nodes[{i}]"),
            format!("({x}, {y})"),
            "finite and within 1e6 m",
        )),
        None => Ok(()),
    }
}

/// A named number of the scene; `None` when it is absent or not finite.
pub fn value(scene: &Scene, name: &str) -> Option<f64> {
    scene.values.get(name)?.as_f64().filter(|v| v.is_finite())
}

/// Named vectors with the nodes that they start from; vectors that are not finite are left out.
pub fn arrows(scene: &Scene, name: &str) -> Vec<([f64; 2], [f64; 2])> {
    let list = scene.arrows.get(name).and_then(|v| v.as_array());
    let vector = |v: &serde_json::Value| {
        let (x, y) = (v.get(0)?.as_f64()?, v.get(1)?.as_f64()?);
        (x.is_finite() && y.is_finite()).then_some([x, y])
    };
    let pairs = scene.nodes.iter().zip(list.into_iter().flatten());
    pairs.filter_map(|(node, v)| Some((*node, vector(v)?))).collect()
}
