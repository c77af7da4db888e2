//! Trials over all cores.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// As many threads as there are cores.
pub fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(2, usize::from)
}

/// Runs `work` on every item, on all cores; results in the order of the items, whatever the number of threads.
///
/// # Errors
/// The first item's whose work failed.
pub fn in_parallel<I: Sync, R: Send, E: Send>(
    items: &[I],
    work: impl Fn(&I) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    in_parallel_on(all_cores(), items, work)
}

/// As [`in_parallel`], on so many threads.
///
/// # Errors
/// The first item's whose work failed.
pub fn in_parallel_on<I: Sync, R: Send, E: Send>(
    threads: usize,
    items: &[I],
    work: impl Fn(&I) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<Result<R, E>>>> = Mutex::new(items.iter().map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let Some((index, item)) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|i| items.get(i).map(|item| (i, item)))
                {
                    let result = work(item);
                    results.lock().expect("no thread panics while it holds the results")[index] = Some(result);
                }
            });
        }
    });
    let results = results.into_inner().expect("no thread panicked");
    results.into_iter().map(|result| result.expect("every item was worked on")).collect()
}
