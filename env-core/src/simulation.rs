//! The bare machines, one at a time, for people who want the physics: no sensors, task or control step.

use crate::error::{Error, Result};
use crate::lane::{DIRECTIONS, Dual};
use crate::scene::NodeState;
use crate::watch::Watch;
use serde_json::{Map, Value};

/// A bare machine that one can step. What is a machine's own (angles, loads, a linear model) it is asked
/// for by name: see `ask` and `act`.
pub trait Simulation: Send {
    /// The word that everything about this machine is looked up by.
    fn machine(&self) -> &'static str;
    /// Every keyword with its value.
    fn resolved(&self) -> Map<String, Value>;
    /// Physical parameters by name.
    fn parameters(&self) -> Vec<(&'static str, f64)>;
    /// Time since the state was set \[s\].
    fn time(&self) -> f64;
    /// Duration of a physics step \[s\].
    fn physics_dt(&self) -> f64;
    /// Positions \[m\] and velocities \[m/s\] of the nodes.
    fn state(&self) -> NodeState;
    /// Sets positions \[m\] and velocities \[m/s\] of all nodes; the time goes back to 0.
    ///
    /// # Errors
    /// Wrong shapes, numbers that are not finite, a motion that this machine cannot have; nothing changes then.
    fn set_state(&mut self, positions: &[[f64; 2]], velocities: &[[f64; 2]]) -> Result<()>;
    /// Takes `n` physics steps under a constant input; the same bits as n steps of one.
    ///
    /// # Errors
    /// An input that is not finite; a step that fails in the smallest parts (the state is then the one before it).
    fn step(&mut self, input: f64, n: u64) -> Result<()>;
    /// Energies by kind \[J\].
    fn energies(&self) -> Vec<(&'static str, f64)>;
    /// What this machine alone can tell: `question` is one of its own words, `arguments` are what it needs.
    ///
    /// # Errors
    /// A word that it does not know, arguments that do not fit.
    fn ask(&self, question: &str, arguments: &[Vec<f64>]) -> Result<Vec<Named>> {
        let _ = arguments;
        Err(unknown(self.machine(), question))
    }
    /// What this machine alone can do, `n` physics steps of it where it steps.
    ///
    /// # Errors
    /// Those of `ask` and `step`.
    fn act(&mut self, command: &str, arguments: &[Vec<f64>], n: u64) -> Result<Vec<Named>> {
        let _ = (arguments, n);
        Err(unknown(self.machine(), command))
    }
    /// The whole state as one vector: all that the next step depends on, in the machine's order.
    ///
    /// # Errors
    /// A machine that has none.
    fn vector(&self) -> Result<Vec<f64>> {
        Err(no_derivatives(self.machine()))
    }
    /// Goes to such a state; the time goes back to 0.
    ///
    /// # Errors
    /// A vector of another length, or none that this machine can have; nothing changes then.
    fn set_vector(&mut self, _vector: &[f64]) -> Result<()> {
        Err(no_derivatives(self.machine()))
    }
    /// Derivatives of that vector after `n` physics steps under a constant input: `A` (s, s) by the vector, `B` (s, 1)
    /// by the input, `P` (s, p) by parameters. The machine stays where it is. Once `watch` stops it, it ends soon, and
    /// what it returns means nothing.
    ///
    /// # Errors
    /// Those of `step`; a name of no parameter; a machine without derivatives.
    fn jacobian(
        &self,
        _input: f64,
        _n: u64,
        _parameters: &[String],
        _watch: Watch<'_>,
    ) -> Result<Vec<Named>> {
        Err(no_derivatives(self.machine()))
    }
    /// Every number that the future depends on, and the steps since the state was set; `restore` takes them.
    fn snapshot(&self) -> (Vec<f64>, u64);
    /// Goes on where a simulation of the same keywords was at its `snapshot`.
    ///
    /// # Errors
    /// Not as many numbers as this machine has; nothing changes then.
    fn restore(&mut self, numbers: &[f64], steps: u64) -> Result<()>;
    /// An independent copy, as it is now.
    fn copy(&self) -> Box<dyn Simulation>;
}

/// A word that a machine does not know.
pub fn unknown(machine: &str, word: &str) -> Error {
    Error::parameter("word", word, format!("one that a {machine} knows"))
}

/// A machine whose steps are not differentiated.
pub fn no_derivatives(machine: &str) -> Error {
    Error::parameter("machine", machine, "one whose steps have derivatives: 'pendulum', 'fin'")
}

/// Numbers with a name and a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Their name.
    pub name: &'static str,
    /// Their shape; empty for a single number.
    pub shape: Vec<usize>,
    /// The numbers, row-major.
    pub values: Vec<f64>,
}

impl Named {
    /// A single number.
    pub fn number(name: &'static str, value: f64) -> Self {
        Named { name, shape: vec![], values: vec![value] }
    }

    /// Numbers in a row.
    pub fn vector(name: &'static str, values: Vec<f64>) -> Self {
        Named { name, shape: vec![values.len()], values }
    }

    /// A matrix of `columns` columns.
    pub fn matrix(name: &'static str, columns: usize, values: Vec<f64>) -> Self {
        Named { name, shape: vec![values.len() / columns, columns], values }
    }

    /// Of every number its slopes in `count` directions from `first` on, a row a number; groups of eight directions
    /// each.
    pub fn slopes(name: &'static str, numbers: &[&[Dual]], first: usize, count: usize) -> Self {
        let rows = numbers[0].len();
        let mut values = Vec::with_capacity(rows * count);
        for row in 0..rows {
            let mut from = first;
            while from < first + count {
                let (group, direction) = (from / DIRECTIONS, from % DIRECTIONS);
                let size = (first + count - from).min(DIRECTIONS - direction);
                let slopes = &numbers[group][row].slopes[direction..direction + size];
                values.extend_from_slice(slopes);
                from += size;
            }
        }
        Named { name, shape: vec![rows, count], values }
    }

    /// The same arrays of several, one under the other: with a first axis of as many.
    pub fn stack(each: Vec<Vec<Named>>) -> Vec<Named> {
        let count = each.len();
        let mut rows = each.into_iter();
        let Some(mut all) = rows.next() else { return vec![] };
        for row in rows {
            for (to, from) in all.iter_mut().zip(row) {
                to.values.extend(from.values);
            }
        }
        for to in &mut all {
            to.shape.insert(0, count);
        }
        all
    }

    /// (x, y) a node.
    pub fn nodes(name: &'static str, nodes: &[[f64; 2]]) -> Self {
        Named::matrix(name, 2, nodes.as_flattened().to_vec())
    }
}

/// (x, y) a node, from a flat argument.
///
/// # Errors
/// An odd number of numbers.
pub fn pairs(name: &str, flat: &[f64]) -> Result<Vec<[f64; 2]>> {
    let (pairs, rest) = flat.as_chunks::<2>();
    if rest.is_empty() {
        return Ok(pairs.to_vec());
    }
    let (name, got) = (name.into(), format!("({},)", flat.len()));
    Err(Error::Shape { name, got, expected: "(nodes, 2)".into() })
}
