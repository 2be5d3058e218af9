//! Delta debugging: the shortest part of a list that still fails.

/// Drops all items of `all` that `fails` does not need; `fails` holds for `all`. The rest fails, and without any one of
/// its items it does not (Zeller and Hildebrandt, 2002).
pub fn shrink<T: Clone>(all: &[T], mut fails: impl FnMut(&[T]) -> bool) -> Vec<T> {
    let mut left = all.to_vec();
    if fails(&[]) {
        return Vec::new();
    }
    let mut size = left.len().div_ceil(2);
    while size > 0 {
        let mut from = 0;
        let mut dropped = false;
        while from < left.len() {
            let mut without = left.clone();
            without.drain(from..(from + size).min(left.len()));
            if !without.is_empty() && fails(&without) {
                left = without;
                dropped = true;
            } else {
                from += size;
            }
        }
        if size > 1 {
            size = size.div_ceil(2);
        } else if !dropped {
            size = 0;
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::shrink;

    #[test]
    fn what_is_needed_stays_and_nothing_else() {
        let all: Vec<u32> = (0..40).collect();
        for needed in [vec![7], vec![0, 39], vec![3, 4, 30], vec![]] {
            let mut tries = 0;
            let left = shrink(&all, |part| {
                tries += 1;
                needed.iter().all(|n| part.contains(n))
            });
            assert_eq!(left, needed);
            assert!(tries < 120, "{tries}");
        }
    }

    #[test]
    fn what_matters_only_together_is_found() {
        // an even number of items fails: two are left, none alone does
        let left = shrink(&[1, 2, 3, 4, 5, 6], |part| !part.is_empty() && part.len() % 2 == 0);
        assert_eq!(left.len(), 2);
    }
}
