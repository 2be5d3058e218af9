//! Several views of one object, put together: as long as it rests, each makes its place surer; when it has moved, a new place begins.

use super::view::{Estimate, INSIDE_95};
use nalgebra::{Matrix3, Vector3};

/// The degrees of freedom of Student's distribution, by which single views that are far off lose their weight.
const NU: f64 = 4.0;
/// Views that are kept of a resting object: the newest.
const KEPT: usize = 64;
/// So many views in a row that are outside their regions of 95 %, and near each other, mean that it has moved.
const MOVED: usize = 3;

/// The place that views of a resting object agree on; `None` if there are none. What they are off in common (`common`, square meters)
/// does not get less with more views.
pub fn fuse(views: &[Estimate], common: &Matrix3<f64>) -> Option<Estimate> {
    let weights: Vec<_> = views.iter().map(|v| v.covariance.try_inverse()).collect::<Option<_>>()?;
    let middle = |axis: usize| {
        let mut all: Vec<f64> = views.iter().map(|v| v.place[axis]).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    let mut place = Vector3::new(middle(0)?, middle(1)?, middle(2)?);
    let mut information = Matrix3::zeros();
    for _ in 0..20 {
        let (mut sum, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (view, of) in views.iter().zip(&weights) {
            let off = view.place - place;
            let weight = (NU + 3.0) / (NU + off.dot(&(of * off)));
            sum += of * weight;
            right += of * view.place * weight;
        }
        place = sum.cholesky()?.solve(&right);
        information = sum;
    }
    Some(Estimate { place, covariance: information.try_inverse()? + common })
}

/// Follows one object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracker {
    /// Views of where it rests.
    views: Vec<Estimate>,
    /// The newest views, if they say that it is elsewhere.
    elsewhere: Vec<Estimate>,
    common: Matrix3<f64>,
}

impl Tracker {
    /// One that has seen nothing.
    pub fn new(common: Matrix3<f64>) -> Tracker {
        Tracker { common, ..Tracker::default() }
    }

    /// One more view; tells whether the object has moved since the last ones.
    pub fn see(&mut self, view: Estimate) -> bool {
        let is_near = |other: &Estimate| {
            let sum = Estimate { place: other.place, covariance: other.covariance + view.covariance + self.common };
            sum.distance(&view.place) <= INSIDE_95
        };
        if self.place().is_none_or(|place| is_near(&place)) {
            self.elsewhere.clear();
            if self.views.len() == KEPT {
                self.views.remove(0);
            }
            self.views.push(view);
            return false;
        }
        if !self.elsewhere.iter().all(is_near) {
            self.elsewhere.clear();
        }
        self.elsewhere.push(view);
        if self.elsewhere.len() < MOVED {
            return false;
        }
        self.views = std::mem::take(&mut self.elsewhere);
        true
    }

    /// Where it rests; `None` before the first view.
    pub fn place(&self) -> Option<Estimate> {
        fuse(&self.views, &self.common)
    }
}
