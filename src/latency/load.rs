//! Other work, on every core.

use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

/// Bytes that each worker walks through: more than the caches hold.
const WORKING_SET: usize = 8 << 20;

/// Threads that keep every core busy until this is dropped.
#[derive(Debug)]
pub struct Load {
    stop: Arc<AtomicBool>,
    workers: Vec<JoinHandle<()>>,
}

/// One worker a core, at ordinary priority: arithmetic, and memory of its own.
pub fn saturate() -> Load {
    let stop = Arc::new(AtomicBool::new(false));
    let cores = thread::available_parallelism().map_or(1, |cores| cores.get());
    let worker = || {
        let stop = Arc::clone(&stop);
        thread::spawn(move || work(&stop))
    };
    Load { workers: (0..cores).map(|_| worker()).collect(), stop }
}

fn work(stop: &AtomicBool) {
    let mut memory = vec![1_u64; WORKING_SET / 8];
    let mut sum = 0_u64;
    while !stop.load(Ordering::Relaxed) {
        for line in memory.chunks_mut(8) {
            sum = sum.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(line[0]);
            line[0] = sum;
        }
        black_box(sum);
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for worker in self.workers.drain(..) {
            // A worker cannot panic, and nothing depends on it.
            let _ = worker.join();
        }
    }
}

/// The machine's load average over the last minute; not a number where the system does not tell.
pub(super) fn average() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().and_then(|first| first.parse().ok()).unwrap_or(f64::NAN)
}
