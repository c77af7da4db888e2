//! The readings of all sensors in one row: by time, and at equal times in the order of the log format.

use std::iter::Peekable;

use shared_types::RawReading;

/// One sensor's readings, whatever it is.
type Source = Box<dyn Iterator<Item = RawReading> + Send>;

/// Merges sources that are in order of time themselves; at equal times the earlier source comes first.
pub(crate) struct Merged {
    sources: Vec<Peekable<Source>>,
}

impl Merged {
    pub(crate) fn new(sources: Vec<Source>) -> Merged {
        Merged { sources: sources.into_iter().map(Iterator::peekable).collect() }
    }
}

impl Iterator for Merged {
    type Item = RawReading;

    fn next(&mut self) -> Option<RawReading> {
        let times = self.sources.iter_mut().map(|source| source.peek().map(RawReading::t_valid));
        let (_, index) = times.enumerate().filter_map(|(index, t)| t.map(|t| (t, index))).min()?;
        self.sources[index].next()
    }
}
