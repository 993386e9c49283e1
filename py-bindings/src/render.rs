//! Pictures as NumPy arrays and as SVG.

use crate::convert::to_map;
use crate::errors::{OrRaise, to_py};
use crate::lock::Lock;
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rodgym_caught::caught;
use rodgym_core::env::Scene;
use rodgym_core::{Error, Result};
use rodgym_render::{Painter, drawing};
use std::collections::HashMap;

/// Width and height \[px\] as asked for; a side left out is the one that suits the machine.
pub type Size = (Option<u32>, Option<u32>);

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Gallery>()
}

/// The painters of a batch: one for each environment that was ever drawn.
#[pyclass(module = "rodgym._native", frozen)]
pub struct Gallery {
    painters: Lock<HashMap<usize, Painter>>,
}

impl Default for Gallery {
    fn default() -> Self {
        Gallery { painters: Lock::new("gallery", HashMap::new()) }
    }
}

#[caught]
#[pymethods]
impl Gallery {
    #[new]
    fn new() -> PyResult<Self> {
        Ok(Gallery::default())
    }

    /// `Batch.render` of a scene that came from elsewhere.
    #[pyo3(signature = (index, scene, width=None, height=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        scene: &Bound<'py, PyDict>,
        width: Option<u32>,
        height: Option<u32>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.picture(py, index, &read(scene)?, (width, height))
    }

    /// `Batch.svg` of a scene that came from elsewhere.
    #[pyo3(name = "svg", signature = (index, scene, width=None, height=None))]
    fn svg_of(
        &self,
        py: Python<'_>,
        index: usize,
        scene: &Bound<'_, PyDict>,
        width: Option<u32>,
        height: Option<u32>,
    ) -> PyResult<String> {
        self.svg(py, index, &read(scene)?, (width, height))
    }
}

fn read(scene: &Bound<'_, PyDict>) -> PyResult<Scene> {
    let refuse =
        |e: serde_json::Error| to_py(Error::parameter("scene", e, "what Batch.scene gives"));
    serde_json::from_value(to_map(scene)?.into()).map_err(refuse)
}

impl Gallery {
    /// Draws the scene of environment `index`: (height, width, 3) uint8.
    pub fn picture<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        scene: &Scene,
        size: Size,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let (width, height) = full(scene, size).or_raise()?;
        let rgb = self.draw(py, index, |painter| painter.render(scene, (width, height)))?;
        PyArray1::from_vec(py, rgb).reshape([height as usize, width as usize, 3])
    }

    /// Draws the scene of environment `index` as an SVG document.
    pub fn svg(&self, py: Python<'_>, index: usize, scene: &Scene, size: Size) -> PyResult<String> {
        let size = full(scene, size).or_raise()?;
        self.draw(py, index, |painter| painter.render_svg(scene, size))
    }

    /// Lets the environment's painter draw, without the GIL.
    fn draw<T: Send>(
        &self,
        py: Python<'_>,
        index: usize,
        draw: impl FnOnce(&mut Painter) -> Result<T> + Send,
    ) -> PyResult<T> {
        let mut guard = self.painters.lock(py)?;
        let painters = &mut *guard;
        py.detach(|| draw(painters.entry(index).or_default())).or_raise()
    }
}

/// The size asked for; a side left out is the one that suits the machine.
fn full(scene: &Scene, (width, height): Size) -> Result<(u32, u32)> {
    let usual = drawing(&scene.machine)?.size;
    Ok((width.unwrap_or(usual.0), height.unwrap_or(usual.1)))
}
