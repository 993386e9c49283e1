//! `Batch`: many environments stepped together, as NumPy sees them.
//!
//! Every call makes its result arrays, hands their memory to Rust, and releases the GIL while Rust fills
//! them. Nothing is copied afterwards, nothing is shared between calls.

mod running;

use crate::arguments::{Actions, bytes, count, read_options, read_seeds, repr};
use crate::arrays;
use crate::convert::{points, serialize, to_map};
use crate::errors::{OrRaise, raise, to_py};
use crate::lock::Lock;
use crate::render::Gallery;
use crate::sim::Simulation;
use numpy::{Ix1, PyArray1, PyArray3, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList, PyTuple};
use rodgym_caught::caught;
use rodgym_core::Error;
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::{AutoresetMode, Scene, Settings, Spec, StepBuffer};
use running::{Inner, derive, fill, step, table};
use serde_json::Value;
use std::sync::MutexGuard;

/// Adds this file's classes and functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Batch>()?;
    module.add("PICTURE_LIMITS", rodgym_render::SIZE_LIMITS)?;
    module.add_function(wrap_pyfunction!(catalog_rows, module)?)
}

/// The rows of the catalogue, as dictionaries: `id`, `machine`, `task`, `max_episode_steps`,
/// `reward_threshold`.
#[caught]
#[pyfunction(name = "catalog")]
fn catalog_rows(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    serialize(py, &catalog::entries())
}

/// A batch of environments of one kind.
///
/// `step` and `reset` return ten arrays for n environments with d observations, k reward terms and
/// metrics, and p parameters: observation (n, d) float32, reward (n), terminated (n), truncated (n),
/// final_observation (n, d) where an episode ended in mode SameStep, terms (n, k) where a step was
/// taken, parameters (n, p) where an episode began, stepped (n), began (n), solver_failure (n).
/// Elsewhere they are zero.
#[pyclass(module = "rodgym._native", frozen)]
pub struct Batch {
    inner: Lock<Inner>,
    gallery: Gallery,
    spec: Spec,
    options: MakeOptions,
}

/// A point (x, y) for each node of each environment.
type Nodes<'py> = Bound<'py, PyArray3<f64>>;
/// Observation (d,), reward, terminated, truncated, info.
type SingleStep<'py> = (Bound<'py, PyArray1<f32>>, f64, bool, bool, Bound<'py, PyDict>);

#[caught]
#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (id, num_envs=None, kwargs=None, autoreset_mode="NextStep", max_episode_steps=None, num_threads=None))]
    fn new(
        id: String,
        num_envs: Option<&Bound<'_, PyAny>>,
        kwargs: Option<&Bound<'_, PyDict>>,
        autoreset_mode: &str,
        max_episode_steps: Option<&Bound<'_, PyAny>>,
        num_threads: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let options = MakeOptions {
            id,
            num_envs: num_envs.map_or(Ok(1), |n| count("num_envs", n))?,
            kwargs: kwargs.map_or_else(|| Ok(Default::default()), to_map)?,
            autoreset_mode: serde_json::from_value(Value::from(autoreset_mode)).map_err(|_| {
                let allowed = "'NextStep', 'SameStep' or 'Disabled'";
                to_py(Error::parameter("autoreset_mode", autoreset_mode, allowed))
            })?,
            max_episode_steps: max_episode_steps
                .map(|n| count("max_episode_steps", n))
                .transpose()?
                .map(|n| u32::try_from(n).unwrap_or(u32::MAX)),
            num_threads: num_threads.map_or(Ok(cores), |n| count("num_threads", n))?,
        };
        let env = catalog::make(&options).or_raise()?;
        let spec = env.spec().clone();
        let actions = vec![0.0; options.num_envs * spec.action.size()];
        let single = options.autoreset_mode == AutoresetMode::Single;
        let buffer = StepBuffer::new(&spec, if single { 1 } else { 0 });
        let inner = Lock::new("batch", Inner { env, actions, buffer });
        Ok(Batch { inner, gallery: Gallery::default(), spec, options })
    }

    /// Everything there is to know before stepping, as dictionaries and lists.
    #[getter]
    fn spec<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        serialize(py, &self.spec)
    }

    /// Number of environments.
    #[getter]
    fn num_envs(&self) -> PyResult<usize> {
        Ok(self.options.num_envs)
    }

    /// "NextStep", "SameStep", "Disabled" or "Single".
    #[getter]
    fn autoreset_mode(&self) -> PyResult<&'static str> {
        Ok(match self.options.autoreset_mode {
            AutoresetMode::NextStep => "NextStep",
            AutoresetMode::SameStep => "SameStep",
            AutoresetMode::Disabled => "Disabled",
            AutoresetMode::Single => "Single",
        })
    }

    /// Steps after which an episode is cut; None: never.
    #[getter]
    fn max_episode_steps(&self) -> PyResult<Option<u32>> {
        Ok(self.options.max_episode_steps)
    }

    /// Number of threads of a step; results do not depend on it.
    #[getter]
    fn num_threads(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.lock(py)?.env.num_threads())
    }

    #[setter]
    fn set_num_threads(&self, py: Python<'_>, threads: &Bound<'_, PyAny>) -> PyResult<()> {
        let threads = count("num_threads", threads)?;
        self.lock(py)?.env.set_num_threads(threads).or_raise()
    }

    /// Starts episodes in all environments, or where `mask` is set. `seeds`: None continues the random
    /// streams, an integer gives environment i the seed + i, a list gives each its own (or None).
    /// `options`: `parameters` and `state`, see the environment's page.
    #[pyo3(signature = (seeds=None, mask=None, options=None, out=None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<&Bound<'py, PyAny>>,
        mask: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let seeds = read_seeds(seeds)?;
        let options = read_options(options)?;
        let mask = mask.map(|mask| arrays::read::<bool, Ix1>("mask", mask)).transpose()?;
        let mask = mask.map(|mask| mask.as_array().to_vec());
        let guard = self.lock(py)?;
        fill(py, guard, out, |inner, data| {
            py.detach(|| inner.env.reset(&seeds, mask.as_deref(), &options, data)).or_raise()
        })
    }

    /// One control step of every environment; `actions` (n, a) numbers, clipped to the space.
    #[pyo3(signature = (actions, out=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let expected = [self.options.num_envs, self.spec.action.size()];
        let actions = Actions::read(actions, &expected)?;
        let mut guard = self.lock(py)?;
        actions.copy_to(&mut guard.actions);
        // (`out` may be the same memory.)
        drop(actions);
        fill(py, guard, out, |Inner { env, actions, .. }, data| {
            step(py, env.as_mut(), actions, data)
        })
    }

    /// `reset` of the one environment of mode Single: observation (d,) and info.
    #[pyo3(signature = (seed=None, options=None))]
    fn reset_single<'py>(
        &self,
        py: Python<'py>,
        seed: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<f32>>, Bound<'py, PyDict>)> {
        self.check_single()?;
        let (seeds, options) = (read_seeds(seed)?, read_options(options)?);
        let mut guard = self.lock(py)?;
        let Inner { env, buffer, .. } = &mut *guard;
        py.detach(|| env.reset(&seeds, None, &options, buffer.data())).or_raise()?;
        let info = PyDict::new(py);
        let names = self.spec.parameters.iter().map(|parameter| parameter.name);
        info.set_item(intern!(py, "parameters"), table(py, names, &buffer.parameters)?)?;
        Ok((PyArray1::from_slice(py, &buffer.observation), info))
    }

    /// `step` of the one environment of mode Single: observation (d,), reward, terminated, truncated, info.
    fn step_single<'py>(
        &self,
        py: Python<'py>,
        action: &Bound<'py, PyAny>,
    ) -> PyResult<SingleStep<'py>> {
        self.check_single()?;
        let action = Actions::read(action, &[self.spec.action.size()])?;
        let mut guard = self.lock(py)?;
        let Inner { env, actions, buffer } = &mut *guard;
        action.copy_to(actions);
        buffer.solver_failure[0] = false;
        step(py, env.as_mut(), actions, buffer.data())?;
        let (terms, metrics) = buffer.terms.split_at(self.spec.reward_terms.len());
        let info = table(py, self.spec.metrics.iter().copied(), metrics)?;
        let terms = table(py, self.spec.reward_terms.iter().copied(), terms)?;
        info.set_item(intern!(py, "reward_terms"), terms)?;
        info.set_item(intern!(py, "solver_failure"), buffer.solver_failure[0])?;
        let observation = PyArray1::from_slice(py, &buffer.observation);
        Ok((observation, buffer.reward[0], buffer.terminated[0], buffer.truncated[0], info))
    }

    /// Everything about environment `index` (physics, random stream, clock) as versioned bytes.
    fn get_state<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.lock(py)?.env.get_state(index).or_raise()?))
    }

    /// Snapshots of environments `first` to `first + count`, all of one moment.
    fn get_states<'py>(
        &self,
        py: Python<'py>,
        first: usize,
        count: usize,
    ) -> PyResult<Vec<Bound<'py, PyBytes>>> {
        let inner = self.lock(py)?;
        let state = |index| Ok(PyBytes::new(py, &inner.env.get_state(index).or_raise()?));
        (first..first + count).map(state).collect()
    }

    /// Nothing to give back: memory and threads go with the object.
    fn close(&self) -> PyResult<()> {
        Ok(())
    }

    /// Puts a snapshot in place of environment `index`.
    fn set_state(&self, py: Python<'_>, index: usize, state: &Bound<'_, PyAny>) -> PyResult<()> {
        self.lock(py)?.env.set_state(index, bytes(state)?).or_raise()
    }

    /// Changes how the parameters of environments `first` to `first + count` are drawn, from the next episode of
    /// each. `parameters`: a number or a list with one each, by name; `randomize`: ranges by name.
    fn configure(
        &self,
        py: Python<'_>,
        first: usize,
        count: usize,
        parameters: &Bound<'_, PyDict>,
        randomize: &Bound<'_, PyDict>,
    ) -> PyResult<()> {
        let settings = Settings { parameters: to_map(parameters)?, randomize: to_map(randomize)? };
        let range = first..first.saturating_add(count);
        self.lock(py)?.env.configure(range, &settings).or_raise()
    }

    /// The last observation of environment `index`: (d,) float32.
    fn observe<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mut observation = vec![0.0; self.spec.observation.size()];
        self.lock(py)?.env.observe(index, &mut observation).or_raise()?;
        Ok(PyArray1::from_vec(py, observation))
    }

    /// What there is to draw of environment `index`, as a dictionary.
    fn scene<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyAny>> {
        serialize(py, &self.scene_of(py, index)?)
    }

    /// A picture of environment `index`: (height, width, 3) uint8, needs no display. A side left out
    /// [pixels] is the one that suits the machine. Earlier pictures of the episode show as a trail.
    #[pyo3(signature = (index, width=None, height=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        width: Option<u32>,
        height: Option<u32>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        self.gallery.picture(py, index, &self.scene_of(py, index)?, (width, height))
    }

    /// The same picture as an SVG document.
    #[pyo3(signature = (index, width=None, height=None))]
    fn svg(
        &self,
        py: Python<'_>,
        index: usize,
        width: Option<u32>,
        height: Option<u32>,
    ) -> PyResult<String> {
        self.gallery.svg(py, index, &self.scene_of(py, index)?, (width, height))
    }

    /// Physical parameters in force in environment `index`, by name.
    fn parameters<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        let values = self.lock(py)?.env.parameters(index).or_raise()?;
        let dict = PyDict::new(py);
        for (parameter, value) in self.spec.parameters.iter().zip(values) {
            dict.set_item(parameter.name, value)?;
        }
        Ok(dict)
    }

    /// Positions [m] and velocities [m/s] of the nodes of environment `index`, each (nodes, 2).
    fn nodes<'py>(
        &self,
        py: Python<'py>,
        index: usize,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let state = self.lock(py)?.env.nodes(index).or_raise()?;
        Ok((points(py, &state.positions)?, points(py, &state.velocities)?))
    }

    /// Positions \[m\] and velocities \[m/s\] of the nodes of all environments, each (n, nodes, 2).
    fn all_nodes<'py>(&self, py: Python<'py>) -> PyResult<(Nodes<'py>, Nodes<'py>)> {
        let guard = self.lock(py)?;
        let (mut positions, mut velocities, mut nodes) = (Vec::new(), Vec::new(), 0);
        for index in 0..self.options.num_envs {
            let state = guard.env.nodes(index).or_raise()?;
            nodes = state.positions.len();
            positions.extend_from_slice(state.positions.as_flattened());
            velocities.extend_from_slice(state.velocities.as_flattened());
        }
        drop(guard);
        let shape = [self.options.num_envs, nodes, 2];
        let array = |numbers| PyArray1::from_vec(py, numbers).reshape(shape);
        Ok((array(positions)?, array(velocities)?))
    }

    /// Derivatives of the control step that environment `index` would take under `action`, by name: `A`, `B`, `P` of
    /// the plant's state vector by that vector, the action and parameters; `C`, `D`, `Q` of the observation;
    /// `reward_state`, `reward_action`, `reward_parameters`.
    fn step_jacobian<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        action: &Bound<'py, PyAny>,
        parameters: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let shape = [self.spec.action.size()];
        let mut guard = self.lock(py)?;
        derive(py, guard.env.as_mut(), (action, &shape), parameters, |env, action, parameters| {
            env.step_jacobian(index, action, parameters)
        })
    }

    /// Gradients of the sum of rewards that environment `index` would get for `actions` (t, a): by `actions` (t, a),
    /// the `state` (s) and `parameters` (p); and the `rewards` (t).
    fn rollout_gradient<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        actions: &Bound<'py, PyAny>,
        parameters: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        // (What has no length has another shape than any that is right.)
        let shape = [actions.len().unwrap_or(0), self.spec.action.size()];
        let mut guard = self.lock(py)?;
        derive(py, guard.env.as_mut(), (actions, &shape), parameters, |env, actions, parameters| {
            env.rollout_gradient(index, actions, parameters)
        })
    }

    /// `step_jacobian` of every environment under its own row of `actions` (n, a), over threads: the same arrays with a
    /// first axis of n.
    fn step_jacobians<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        parameters: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let shape = [self.options.num_envs, self.spec.action.size()];
        let mut guard = self.lock(py)?;
        derive(py, guard.env.as_mut(), (actions, &shape), parameters, |env, actions, parameters| {
            env.step_jacobians(actions, parameters)
        })
    }

    /// `rollout_gradient` of every environment for its own `actions` (n, t, a), over threads: the same arrays with a
    /// first axis of n.
    fn rollout_gradients<'py>(
        &self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
        parameters: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        // (What has no second axis has another shape than any that is right.)
        let steps = actions.get_item(0).and_then(|row| row.len()).unwrap_or(0);
        let shape = [self.options.num_envs, steps, self.spec.action.size()];
        let mut guard = self.lock(py)?;
        derive(py, guard.env.as_mut(), (actions, &shape), parameters, |env, actions, parameters| {
            env.rollout_gradients(actions, parameters)
        })
    }

    /// An exact copy of what runs in environment `index`: stepping it leaves the environment alone.
    fn simulation(&self, py: Python<'_>, index: usize) -> PyResult<Simulation> {
        Ok(Simulation::of(self.lock(py)?.env.simulation(index).or_raise()?))
    }

    /// Pickling keeps the state: arguments first, then one snapshot an environment.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let inner = this.lock(py)?;
        let states = PyList::empty(py);
        for index in 0..this.options.num_envs {
            match inner.env.get_state(index) {
                Ok(state) => states.append(PyBytes::new(py, &state))?,
                Err(Error::NotReset) => states.append(py.None())?,
                Err(error) => return Err(to_py(error)),
            }
        }
        let options = &this.options;
        let arguments = (
            &options.id,
            options.num_envs,
            serialize(py, &options.kwargs)?,
            this.autoreset_mode()?,
            options.max_episode_steps,
            inner.env.num_threads(),
        );
        (slf.get_type(), arguments, states).into_pyobject(py)
    }

    fn __setstate__(&self, py: Python<'_>, states: &Bound<'_, PyAny>) -> PyResult<()> {
        let Ok(states) = states.cast::<PyList>() else {
            let allowed = "a list of snapshots, or None";
            return Err(to_py(Error::parameter("states", repr(states), allowed)));
        };
        let mut inner = self.lock(py)?;
        for (index, state) in states.iter().enumerate() {
            if !state.is_none() {
                inner.env.set_state(index, bytes(&state)?).or_raise()?;
            }
        }
        Ok(())
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!("Batch({:?}, num_envs={})", self.spec.id, self.options.num_envs))
    }
}

impl Batch {
    fn check_single(&self) -> PyResult<()> {
        if self.options.autoreset_mode == AutoresetMode::Single && self.options.num_envs == 1 {
            return Ok(());
        }
        Err(raise("RodgymError", "this batch was not made as one environment of mode 'Single'"))
    }

    /// What there is to draw of environment `index`.
    pub fn scene_of(&self, py: Python<'_>, index: usize) -> PyResult<Scene> {
        self.lock(py)?.env.scene(index).or_raise()
    }

    /// The batch, waiting without the GIL while another thread steps it.
    pub(crate) fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Inner>> {
        self.inner.lock(py)
    }
}
