//! Threads for long work. The next job is one of the user who has the fewest running, so that nobody's
//! batches keep another's waiting for long.

use crate::transport::{Transport, Waker};
use crate::work::{Finished, Work};
use std::io;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Work of a user, with what its sender wants back beside the result.
pub struct Job<T> {
    /// Who asked.
    pub user: Arc<str>,
    /// What to compute.
    pub work: Work,
    /// Comes back with the result.
    pub tag: T,
}

/// Threads, what they do, and what waits for them.
pub struct Pool<T> {
    threads: Vec<Sender<Job<T>>>,
    done: Receiver<(usize, T, Finished)>,
    /// Whose job each thread has.
    running: Vec<Option<Arc<str>>>,
    queue: Vec<Job<T>>,
}

impl<T: Send + 'static> Pool<T> {
    /// Starts threads. They end with the pool, after what they are at.
    ///
    /// # Errors
    /// No resources.
    pub fn start(threads: usize, transport: &mut dyn Transport) -> io::Result<Self> {
        let (finished, done) = channel();
        let mut senders = Vec::new();
        for number in 0..threads.max(1) {
            let (sender, jobs) = channel();
            let (finished, waker) = (finished.clone(), transport.waker()?);
            let work = move || work(number, &jobs, &finished, &waker);
            std::thread::Builder::new().name(format!("worker-{number}")).spawn(work)?;
            senders.push(sender);
        }
        let running = vec![None; senders.len()];
        Ok(Pool { threads: senders, done, running, queue: Vec::new() })
    }

    /// Computes it when a thread is free.
    pub fn submit(&mut self, job: Job<T>) {
        self.queue.push(job);
        self.assign();
    }

    /// A result, if there is one.
    pub fn finished(&mut self) -> Option<(T, Finished)> {
        let (number, tag, finished) = self.done.try_recv().ok()?;
        self.running[number] = None;
        self.assign();
        Some((tag, finished))
    }

    /// Whether nothing runs or waits.
    pub fn is_idle(&self) -> bool {
        self.queue.is_empty() && self.running.iter().all(Option::is_none)
    }

    fn assign(&mut self) {
        while let Some(free) = self.running.iter().position(Option::is_none) {
            let has = |user| self.running.iter().flatten().filter(|u| *u == user).count();
            // The first of equals has waited longest.
            let next = (0..self.queue.len()).min_by_key(|i| has(&self.queue[*i].user));
            let Some(next) = next else { return };
            let job = self.queue.remove(next);
            let alone = self.is_idle();
            self.running[free] = Some(job.user.clone());
            let job = Job { work: job.work.alone(alone), ..job };
            self.threads[free].send(job).expect("a worker ends with the pool only");
        }
    }
}

fn work<T>(
    number: usize,
    jobs: &Receiver<Job<T>>,
    done: &Sender<(usize, T, Finished)>,
    waker: &Waker,
) {
    while let Ok(Job { work, tag, .. }) = jobs.recv() {
        if done.send((number, tag, work.run())).is_err() {
            return;
        }
        waker();
    }
}
