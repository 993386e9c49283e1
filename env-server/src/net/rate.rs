//! So many log lines of a kind, however often strangers make it happen.

use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Lines of a kind in one period.
const LINES: u32 = 10;
const PERIOD: Duration = Duration::from_secs(10);

/// What may be logged now.
#[derive(Debug, Default)]
pub struct Rate(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    since: Option<Instant>,
    lines: u32,
    left_out: u64,
}

impl Rate {
    /// Whether a line may be written now; then the number of those left out before it.
    pub fn line(&self, now: Instant) -> Option<u64> {
        let mut state = self.0.lock().expect("no panic while held");
        if state.since.is_none_or(|since| now.saturating_duration_since(since) >= PERIOD) {
            (state.since, state.lines) = (Some(now), 0);
        }
        if state.lines == LINES {
            state.left_out += 1;
            return None;
        }
        state.lines += 1;
        Some(std::mem::take(&mut state.left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_writes_few_lines_and_the_next_one_tells_how_many_were_left_out() {
        let (rate, start) = (Rate::default(), Instant::now());
        let told: Vec<_> = (0..1000).map(|_| rate.line(start)).collect();
        assert_eq!(told.iter().flatten().count(), LINES as usize);
        assert_eq!(rate.line(start + PERIOD), Some(1000 - u64::from(LINES)));
        assert_eq!(rate.line(start + PERIOD), Some(0));
    }
}
