//! A list of which the first part is shared by many copies.

use std::ops::Index;
use std::sync::Arc;

/// Items of the robots of a scene, which edits do not change, followed by those of its objects.
#[derive(Clone, Debug)]
pub(crate) struct SharedList<T> {
    shared: Arc<[T]>,
    own: Vec<T>,
}

impl<T> SharedList<T> {
    pub fn new(shared: impl IntoIterator<Item = T>) -> Self {
        SharedList { shared: shared.into_iter().collect(), own: Vec::new() }
    }

    /// The same shared part with other items after it.
    pub fn followed_by(&self, own: impl IntoIterator<Item = T>) -> Self {
        SharedList { shared: self.shared.clone(), own: own.into_iter().collect() }
    }

    /// The items after the shared part.
    pub fn own(&self) -> &[T] {
        &self.own
    }

    /// Length of the shared part.
    pub fn shared_len(&self) -> usize {
        self.shared.len()
    }

    pub fn len(&self) -> usize {
        self.shared.len() + self.own.len()
    }

    pub fn get(&self, i: usize) -> Option<&T> {
        self.shared.get(i).or_else(|| self.own.get(i.checked_sub(self.shared.len())?))
    }

    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.shared.iter().chain(&self.own)
    }
}

impl<T> Index<usize> for SharedList<T> {
    type Output = T;

    fn index(&self, i: usize) -> &T {
        let shared = &self.shared;
        if i < shared.len() { &shared[i] } else { &self.own[i - shared.len()] }
    }
}
