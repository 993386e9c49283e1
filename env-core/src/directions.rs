//! What is differentiated by, in groups of eight directions: numbers that are their own variables.

use crate::error::{Error, Result};
use crate::lane::{DIRECTIONS, Dual};

/// Groups that `count` directions need.
pub fn group_count(count: usize) -> usize {
    count.div_ceil(DIRECTIONS)
}

/// Whether a group has any of `count` directions from `first` on.
pub fn has_any(group: usize, first: usize, count: usize) -> bool {
    first < (group + 1) * DIRECTIONS && group * DIRECTIONS < first + count
}

/// The numbers `values`, of which the direction `first + i` is that of the i-th, as a group of directions has them.
pub fn seeded(values: &[f64], first: usize, group: usize) -> Vec<Dual> {
    let seed = |(i, &value): (usize, &f64)| match (first + i).checked_sub(group * DIRECTIONS) {
        Some(direction) if direction < DIRECTIONS => Dual::variable(value, direction),
        _ => Dual::constant(value),
    };
    values.iter().enumerate().map(seed).collect()
}

/// The same for all `values`, of which those in the places `chosen` are differentiated by.
pub fn seeded_at(values: &[f64], chosen: &[usize], first: usize, group: usize) -> Vec<Dual> {
    let mut all: Vec<Dual> = values.iter().map(|&value| Dual::constant(value)).collect();
    let picked: Vec<f64> = chosen.iter().map(|&i| values[i]).collect();
    for (&i, dual) in chosen.iter().zip(seeded(&picked, first, group)) {
        // (What is named twice has two columns.)
        for (to, slope) in all[i].slopes.iter_mut().zip(dual.slopes) {
            *to += slope;
        }
    }
    all
}

/// Whether a number changes in any of its directions.
pub fn moves(x: &Dual) -> bool {
    x.slopes != [0.0; DIRECTIONS]
}

/// Refuses a vector of another length.
///
/// # Errors
/// Says how long it is and should be.
pub fn check_size(name: &str, given: &[f64], wanted: usize) -> Result<()> {
    if given.len() == wanted {
        return Ok(());
    }
    let (got, expected) = (format!("({},)", given.len()), format!("({wanted},)"));
    Err(Error::Shape { name: name.into(), got, expected })
}
