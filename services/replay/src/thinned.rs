//! A long series kept short: constant memory, even spacing, and of each stretch the item that matters most.

/// At most `limit` items of a series of any length.
#[derive(Debug)]
pub(crate) struct Thinned<T> {
    limit: usize,
    /// How many items of the series each kept one stands for.
    stride: usize,
    in_stretch: usize,
    kept: Vec<T>,
    matters_more: fn(&T, &T) -> bool,
}

impl<T> Thinned<T> {
    /// `matters_more(a, b)`: whether `a` shall stand for a stretch rather than the earlier `b`.
    pub(crate) fn new(limit: usize, matters_more: fn(&T, &T) -> bool) -> Thinned<T> {
        Thinned { limit: limit.max(2), stride: 1, in_stretch: 0, kept: Vec::new(), matters_more }
    }

    pub(crate) fn push(&mut self, item: T) {
        if self.in_stretch > 0 {
            let last = self.kept.last_mut().expect("a stretch begins with an item");
            if (self.matters_more)(&item, last) {
                *last = item;
            }
        } else {
            if self.kept.len() == self.limit {
                self.halve();
            }
            self.kept.push(item);
        }
        self.in_stretch = (self.in_stretch + 1) % self.stride;
    }

    fn halve(&mut self) {
        let matters_more = self.matters_more;
        let mut halved: Vec<T> = Vec::with_capacity(self.limit);
        for (index, item) in self.kept.drain(..).enumerate() {
            match halved.last_mut() {
                Some(last) if index % 2 == 1 => {
                    if matters_more(&item, last) {
                        *last = item;
                    }
                }
                _ => halved.push(item),
            }
        }
        self.kept = halved;
        self.stride *= 2;
    }

    pub(crate) fn items(&self) -> &[T] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_keeps_its_order_its_ends_and_its_spikes() {
        let mut series = Thinned::new(100, |a: &(usize, u32), b: &(usize, u32)| a.1 > b.1);
        for index in 0..12_345 {
            series.push((index, if index == 7_777 { 5 } else { 0 }));
        }
        let items = series.items();
        assert!((50..=100).contains(&items.len()), "{}", items.len());
        assert!(items.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert_eq!(items[0].0, 0);
        assert!(items.contains(&(7_777, 5)));
        assert!(items[items.len() - 1].0 > 12_000);
    }

    #[test]
    fn a_short_series_is_kept_whole() {
        let mut series = Thinned::new(10, |_, _| false);
        (0..10).for_each(|index| series.push(index));
        assert_eq!(series.items(), (0..10).collect::<Vec<_>>());
    }
}
