//! Pose of a square in the camera frame from its corners in the image.

use crate::locators::lens::Lens;
use mobee_contract::SeenPose;
use nalgebra::{Matrix2x6, Matrix3, Matrix6, SMatrix, SVector, UnitQuaternion, Vector2, Vector3, Vector6};

/// Standard deviation of each coordinate of a corner, pixels: see docs/detectors.md.
const CORNER_SIGMA_PX: f64 = 0.12;
/// Maximum number of Levenberg-Marquardt steps.
const MAX_STEPS: usize = 30;

/// Estimated pose in the camera frame.
#[derive(Clone, Copy, Debug)]
struct Guess {
    at: Vector3<f64>,
    turn: UnitQuaternion<f64>,
}

/// A refined estimate: half the sum of the squared whitened residuals, and the information matrix
/// of position and rotation.
#[derive(Clone, Copy, Debug)]
struct PoseFit {
    guess: Guess,
    cost: f64,
    information: Matrix6<f64>,
}

/// Returns the pose of a square in the camera frame; `None` if no such square is in front of the
/// camera. The x axis of the square points to the right and its y axis down, as printed, its z axis
/// into it.
///
/// The image of a small or distant square often has two solutions, mirrored about the line of
/// sight. The better one is returned; the other one enlarges the covariance according to its
/// likelihood.
///
/// # Arguments
/// * `corners`: upper left, upper right, lower right and lower left, pixels.
/// * `size`: edge of the square, meters.
pub fn pose_of_square(corners: &[[f64; 2]; 4], size: f64, lens: &Lens) -> Option<SeenPose> {
    if !lens.is_sound() || size.is_nan() || size <= 0.0 {
        return None;
    }
    let first = refine(&initial_pose(corners, size, lens)?, corners, size, lens)?;
    let other = refine(&mirrored(&first.guess), corners, size, lens);
    let (best, other) = match other {
        Some(other) if other.cost < first.cost => (other, Some(first)),
        other => (first, other),
    };
    let mut covariance = best.information.try_inverse()?;
    if let Some(other) = other {
        let apart = difference(&best.guess, &other.guess);
        let chance = (best.cost - other.cost).exp();
        covariance += apart * apart.transpose() * (chance / (1.0 + chance));
    }
    let Guess { at, turn } = best.guess;
    let is_sound = at.z > 0.0 && covariance.iter().chain(at.iter()).all(|n| n.is_finite());
    let row = |i: usize| std::array::from_fn(|j| covariance[(i, j)]);
    is_sound.then(|| SeenPose {
        position: at.into(),
        rotation: [turn.w, turn.i, turn.j, turn.k],
        covariance: std::array::from_fn(row),
    })
}

/// Returns the corners in the square's own frame, meters.
fn own(size: f64) -> [Vector3<f64>; 4] {
    let half = size / 2.0;
    [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| Vector3::new(x, y, 0.0))
}

/// Computes an initial estimate from the homography from the square to the directions of its
/// corners.
fn initial_pose(corners: &[[f64; 2]; 4], size: f64, lens: &Lens) -> Option<Guess> {
    let mut equations = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for (k, (corner, own)) in corners.iter().zip(own(size)).enumerate() {
        let seen = lens.ray(&Vector2::from(*corner));
        let x = own.x;
        let y = own.y;
        for (i, s) in [seen.x, seen.y].into_iter().enumerate() {
            let row = 2 * k + i;
            for (j, value) in [x, y, 1.0].into_iter().enumerate() {
                equations[(row, 3 * i + j)] = value;
            }
            equations[(row, 6)] = -s * x;
            equations[(row, 7)] = -s * y;
            right[row] = s;
        }
    }
    let h = equations.lu().solve(&right)?;
    let columns = [Vector3::new(h[0], h[3], h[6]), Vector3::new(h[1], h[4], h[7]), Vector3::new(h[2], h[5], 1.0)];
    let scale = (columns[0].norm() * columns[1].norm()).sqrt();
    let [right, down, at] = columns.map(|c| c / scale);
    // The nearest rotation.
    let svd = Matrix3::from_columns(&[right, down, right.cross(&down)]).svd(true, true);
    let turn = nalgebra::Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?);
    let guess = Guess { at, turn: UnitQuaternion::from_rotation_matrix(&turn) };
    at.iter().all(|n| n.is_finite()).then_some(guess)
}

/// Returns the other solution for almost the same image: the normal mirrored about the line of
/// sight.
fn mirrored(guess: &Guess) -> Guess {
    let sight = guess.at.normalize();
    let normal = guess.turn * Vector3::z();
    let other = sight * (2.0 * normal.dot(&sight)) - normal;
    let by = UnitQuaternion::rotation_between(&normal, &other).unwrap_or_default();
    Guess { at: guess.at, turn: by * guess.turn }
}

/// Returns the difference of two estimates: translation, and rotation vector about the camera's
/// axes.
fn difference(from: &Guess, to: &Guess) -> Vector6<f64> {
    let way = to.at - from.at;
    let turn = (to.turn * from.turn.inverse()).scaled_axis();
    Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z)
}

/// Returns the gradient, the information matrix and the cost (half the sum of the squared whitened
/// residuals) of an estimate.
fn look(guess: &Guess, corners: &[[f64; 2]; 4], size: f64, lens: &Lens) -> Option<(Vector6<f64>, Matrix6<f64>, f64)> {
    let mut gradient = Vector6::zeros();
    let mut information = Matrix6::zeros();
    let mut cost = 0.0;
    for (corner, own) in corners.iter().zip(own(size)) {
        let arm = guess.turn * own;
        let (pixel, by) = lens.project(&(guess.at + arm))?;
        let off = (Vector2::from(*corner) - pixel) / CORNER_SIGMA_PX;
        let mut jacobian = Matrix2x6::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&(by / CORNER_SIGMA_PX));
        // A small rotation moves the corner by rotation x arm.
        jacobian.fixed_columns_mut::<3>(3).copy_from(&(by * -arm.cross_matrix() / CORNER_SIGMA_PX));
        gradient += jacobian.transpose() * off;
        information += jacobian.transpose() * jacobian;
        cost += off.norm_squared() / 2.0;
    }
    Some((gradient, information, cost))
}

/// Refines an estimate by Levenberg-Marquardt.
fn refine(guess: &Guess, corners: &[[f64; 2]; 4], size: f64, lens: &Lens) -> Option<PoseFit> {
    let mut guess = *guess;
    let (mut gradient, mut information, mut cost) = look(&guess, corners, size, lens)?;
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let mut damped = information;
        for i in 0..6 {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&gradient);
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned()) * guess.turn;
        let next = Guess { at: guess.at + step.fixed_rows::<3>(0), turn };
        match look(&next, corners, size, lens) {
            Some(better) if better.2 <= cost => {
                let gained = cost - better.2;
                guess = next;
                (gradient, information, cost) = better;
                damping *= 0.2;
                if gained < 1e-9 {
                    break;
                }
            }
            _ => damping *= 8.0,
        }
    }
    Some(PoseFit { guess, cost, information })
}
