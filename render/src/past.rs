//! What a painter remembers of an episode, so that pictures can show the way here.

use crate::view::value;
use rodgym_core::env::Scene;
use std::collections::VecDeque;

/// Steps that are remembered, and that a trace shows.
pub const MEMORY: u32 = 200;

/// One picture of the past.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Steps since the episode began.
    pub step: u32,
    /// Time since then \[s\].
    pub time: f64,
    /// The last node \[m\].
    pub tip: [f64; 2],
    /// Thrust \[N\], where there is one.
    pub thrust: Option<f64>,
}

/// Moments of one episode in order, the present one last.
#[derive(Clone, Debug, Default)]
pub struct Past {
    /// The oldest first.
    pub moments: VecDeque<Moment>,
}

impl Past {
    /// Adds the present; whatever was not before it belongs to another episode and is forgotten.
    pub fn note(&mut self, scene: &Scene) {
        let now = Moment {
            step: scene.steps,
            time: scene.time,
            tip: scene.nodes[scene.nodes.len() - 1],
            thrust: value(scene, "thrust"),
        };
        let ended = self.moments.back().is_some_and(|last| last.step > now.step);
        if ended {
            self.moments.clear();
        }
        self.moments.retain(|m| m.step != now.step && now.step - m.step < MEMORY);
        self.moments.push_back(now);
    }

    /// Where the tip was in the last `steps` steps, the newest first, with its freshness: 1 now, 0 then.
    pub fn trail<'a>(&'a self, steps: u32) -> impl Iterator<Item = (&'a Moment, f32)> + 'a {
        let now = self.moments.back().map_or(0, |m| m.step);
        let age = move |m: &Moment| (now - m.step) as f32 / steps as f32;
        self.moments.iter().rev().map(move |m| (m, 1.0 - age(m))).take_while(|(_, f)| *f > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(steps: u32) -> Scene {
        Scene {
            machine: "pendulum".into(),
            time: f64::from(steps) * 0.01,
            steps,
            nodes: vec![[0.0, 0.0], [0.1, 0.0]],
            thickness: vec![0.007; 2],
            curvature: vec![0.0; 2],
            action: vec![],
            reward: 0.0,
            episode_return: 0.0,
            values: Default::default(),
            arrows: Default::default(),
        }
    }

    #[test]
    fn an_episode_is_forgotten_when_the_next_begins_and_memory_is_bounded() {
        let mut past = Past::default();
        for step in [0, 3, 3, 5] {
            past.note(&scene(step));
        }
        assert_eq!(past.moments.iter().map(|m| m.step).collect::<Vec<_>>(), [0, 3, 5]);
        past.note(&scene(1));
        assert_eq!(past.moments.iter().map(|m| m.step).collect::<Vec<_>>(), [1]);
        for step in 2..1000 {
            past.note(&scene(step));
        }
        assert_eq!(past.moments.len(), MEMORY as usize);
    }
}
