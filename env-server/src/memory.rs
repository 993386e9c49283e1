//! Memory that the server has promised: sessions with their reply windows, requests that wait, replies
//! that are not read yet. Whoever needs more than is left is refused, before anything is allocated.

use crate::error::{Code, Refusal};
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// What a message costs beside its bytes: descriptions, queues, the allocator's own.
pub const MESSAGE: usize = 512;

/// What is promised, in all and by user \[bytes\].
#[derive(Debug)]
pub struct Ledger {
    most: usize,
    most_per_user: usize,
    taken: Mutex<Taken>,
}

#[derive(Debug, Default)]
struct Taken {
    all: usize,
    users: HashMap<Arc<str>, usize>,
}

impl Ledger {
    /// Nothing promised yet.
    pub fn new(most: usize, most_per_user: usize) -> Arc<Self> {
        Arc::new(Ledger { most, most_per_user, taken: Mutex::default() })
    }

    /// Promises memory to a user, until the charge is dropped.
    ///
    /// # Errors
    /// `limit`, with a time to wait if it could be had at another time.
    pub fn take(self: &Arc<Self>, user: &Arc<str>, bytes: usize) -> Result<Charge, Refusal> {
        let mut taken = self.taken.lock().expect("no panic while held");
        let (all, mine) = (taken.all, taken.users.get(user).copied().unwrap_or(0));
        let refuse = |whose: &str, used: usize, most: usize| {
            let text = format!(
                "{bytes} bytes of memory are needed; {used} of the {most} {whose} are taken"
            );
            Err(match bytes > most {
                true => Refusal::new(Code::Limit, text),
                false => Refusal::later(Code::Limit, text, 1000),
            })
        };
        if bytes > self.most_per_user.saturating_sub(mine) {
            return refuse(&format!("of user '{user}'"), mine, self.most_per_user);
        }
        if bytes > self.most.saturating_sub(all) {
            return refuse("of this server", all, self.most);
        }
        taken.all += bytes;
        *taken.users.entry(user.clone()).or_default() += bytes;
        Ok(Charge { ledger: self.clone(), user: user.clone(), bytes })
    }

    /// Bytes promised now.
    pub fn taken(&self) -> usize {
        self.taken.lock().expect("no panic while held").all
    }
}

/// Memory promised to a user; given back when dropped, on any thread.
#[derive(Debug)]
pub struct Charge {
    ledger: Arc<Ledger>,
    user: Arc<str>,
    bytes: usize,
}

impl Drop for Charge {
    fn drop(&mut self) {
        let mut taken = self.ledger.taken.lock().expect("no panic while held");
        taken.all -= self.bytes;
        if let Some(mine) = taken.users.get_mut(&self.user) {
            *mine -= self.bytes;
            if *mine == 0 {
                taken.users.remove(&self.user);
            }
        }
    }
}

/// Half of what this machine has, or of what its cgroup grants where that is less \[bytes\].
pub fn half_of_the_machine() -> u64 {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("MemTotal:"))?;
        Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
    });
    // Another system: little enough for any machine of today.
    let machine = machine.unwrap_or(4 << 30);
    cgroup().map_or(machine, |granted| granted.min(machine)) / 2
}

/// The least limit of our cgroup and those above it, version 2 or 1.
fn cgroup() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let mut least = None;
    for line in text.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (kinds, path) = (parts.next()?, parts.next()?);
        let (root, file) = match kinds {
            "" => ("/sys/fs/cgroup", "memory.max"),
            kinds if kinds.split(',').any(|k| k == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => continue,
        };
        // In a container the path may be the host's: then only the root is there.
        let ours = std::path::Path::new(path.trim_start_matches('/'));
        for folder in ours.ancestors() {
            let file = std::path::Path::new(root).join(folder).join(file);
            let limit = std::fs::read_to_string(file).ok().and_then(|t| t.trim().parse().ok());
            least = match (least, limit) {
                (Some(a), Some(b)) => Some(u64::min(a, b)),
                (a, b) => a.or(b),
            };
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_promised_is_given_back_and_never_exceeded() {
        let ledger = Ledger::new(100, 60);
        let (ada, bob): (Arc<str>, Arc<str>) = ("ada".into(), "bob".into());
        let first = ledger.take(&ada, 50).expect("there is room");
        let own = ledger.take(&ada, 11).expect_err("61 of 60");
        assert!(own.msg.contains("11") && own.msg.contains("50 of the 60"), "{own}");
        assert_eq!(own.retry(), "same");
        let second = ledger.take(&bob, 50).expect("there is room");
        assert!(ledger.take(&bob, 1).expect_err("101 of 100").msg.contains("100 of the 100"));
        drop(first);
        assert_eq!(ledger.taken(), 50);
        assert_eq!(ledger.take(&ada, 61).expect_err("never").retry(), "never");
        assert!(ledger.take(&ada, usize::MAX).is_err());
        drop(second);
        assert_eq!(ledger.taken(), 0);
        assert!(ledger.taken.lock().expect("no panic").users.is_empty());
    }

    #[test]
    fn half_of_the_machine_is_a_sensible_number() {
        assert!(half_of_the_machine() >= 16 << 20);
    }
}
