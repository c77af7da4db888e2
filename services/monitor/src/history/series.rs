//! A long series kept short: constant memory, even spacing, and what falls together is merged.

/// At most `limit` items of a series of any length.
#[derive(Clone, Debug)]
pub(crate) struct Series<T> {
    limit: usize,
    /// How many items of the series each kept one stands for.
    stride: usize,
    in_stretch: usize,
    kept: Vec<T>,
    merge: fn(&mut T, T),
}

impl<T> Series<T> {
    /// `merge(a, b)` lets the earlier `a` stand for the later `b`, too.
    pub(crate) fn new(limit: usize, merge: fn(&mut T, T)) -> Series<T> {
        Series { limit: limit.max(2), stride: 1, in_stretch: 0, kept: Vec::new(), merge }
    }

    pub(crate) fn push(&mut self, item: T) {
        if self.in_stretch > 0 {
            let last = self.kept.last_mut().expect("a stretch begins with an item");
            (self.merge)(last, item);
        } else {
            if self.kept.len() == self.limit {
                self.halve();
            }
            self.kept.push(item);
        }
        self.in_stretch = (self.in_stretch + 1) % self.stride;
    }

    fn halve(&mut self) {
        let mut halved: Vec<T> = Vec::with_capacity(self.limit);
        for (index, item) in self.kept.drain(..).enumerate() {
            match halved.last_mut() {
                Some(last) if index % 2 == 1 => (self.merge)(last, item),
                _ => halved.push(item),
            }
        }
        self.kept = halved;
        self.stride *= 2;
    }

    /// Earliest first.
    pub(crate) fn items(&self) -> &[T] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_keeps_its_order_its_ends_and_its_sums() {
        let mut series = Series::new(100, |a: &mut (usize, u32), b| a.1 += b.1);
        (0..12_345).for_each(|index| series.push((index, 1)));
        let items = series.items();
        assert!((50..=100).contains(&items.len()), "{}", items.len());
        assert!(items.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert_eq!(items[0].0, 0);
        assert_eq!(items.iter().map(|item| item.1).sum::<u32>(), 12_345, "nothing is lost in merging");
    }

    #[test]
    fn a_short_series_is_kept_whole() {
        let mut series = Series::new(10, |_: &mut i32, _| {});
        (0..10).for_each(|index| series.push(index));
        assert_eq!(series.items(), (0..10).collect::<Vec<_>>());
    }
}
