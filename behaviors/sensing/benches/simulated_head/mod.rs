//! Simulated heads that deviate from their nominal kinematics in every way known from real ones,
//! their views, and the best possible accuracy of a position after this number of views: the
//! information bound (Cramer and Rao).

use mobee_sensing::locators::beginning::Beginning;
use mobee_sensing::locators::calibrated::Calibrated;
use mobee_sensing::locators::head::{HeadKind, JointAngles};
use mobee_sensing::locators::lens::Lens;
use mobee_sensing::locators::model::HeadModel;
use mobee_sensing::locators::parameters::PlaceFrame;
use mobee_sensing::locators::view::{Glimpse, KnownView, StereoView};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Matrix4x3, Rotation3, Vector3, Vector4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Standard deviation of the pixels.
const PIXEL: f64 = 1.0;
/// Backlash of the joints of neck and eyes, rad, to either side.
const BACKLASH: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// Share of views in which an eye detected something else.
const OUTLIERS: f64 = 0.15;
/// Ranges of the joints, degrees.
const RANGES: [(f64, f64); 9] = [
    (0.0, 30.0),
    (-10.0, 10.0),
    (-15.0, 15.0),
    (-30.0, 0.0),
    (-10.0, 10.0),
    (-20.0, 20.0),
    (-15.0, 15.0),
    (-15.0, 15.0),
    (0.0, 20.0),
];

/// A simulated head.
pub struct SimulatedHead {
    /// True model.
    pub model: HeadModel,
    rng: ChaCha8Rng,
}

/// Standard deviation of each parameter's error, in the order of the model.
fn deviations() -> Vec<f64> {
    let degree = 1.0_f64.to_radians();
    let mut all = vec![1.5 * degree; 8];
    all.push(2.0 * degree);
    all.extend([0.01; 9]);
    all.extend([degree; 3]);
    for _ in 0..2 {
        all.extend([degree, degree, degree, 0.03, 8.0, 8.0, 0.05]);
    }
    all.extend([0.0; 7]);
    all
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (rng.random_range(1e-12..1.0), rng.random());
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

impl SimulatedHead {
    /// Creates one of many heads.
    pub fn new(seed: u64) -> SimulatedHead {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let angles = [0; 3].map(|_| rng.random_range(-3.0..3.0));
        let rotation = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
        let origin = Vector3::from([0; 3].map(|_| rng.random_range(-1.0..1.0)));
        let mut model = HeadModel::nominal(HeadKind::V1, Lens::icub(), PlaceFrame { rotation, origin });
        model.theta = deviations().into_iter().map(|d| d * normal(&mut rng)).collect();
        SimulatedHead { model, rng }
    }

    fn place(&mut self) -> Vector3<f64> {
        let root = Vector3::new(
            self.rng.random_range(-0.6..-0.3),
            self.rng.random_range(-0.2..0.2),
            self.rng.random_range(0.0..0.4),
        );
        self.model.frame.rotation.tr_mul(&(root - self.model.frame.origin))
    }

    /// Creates a view of a position; `outliers`: an eye may have detected something else.
    pub fn view(&mut self, outliers: bool) -> KnownView {
        loop {
            let place = self.place();
            let encoders: JointAngles = RANGES.map(|(low, high)| self.rng.random_range(low..high).to_radians());
            let mut standing = encoders;
            for joint in standing.iter_mut().skip(3) {
                *joint += if self.rng.random() { BACKLASH } else { -BACKLASH };
            }
            let Some(mut pixels) = self.model.pixels(&standing, &place) else { continue };
            let inside = |p: &Vector4<f64>| (0..4).all(|i| (0.0..[640.0, 480.0][i % 2]).contains(&p[i]));
            if !inside(&pixels) {
                continue;
            }
            pixels += Vector4::from_fn(|_, _| PIXEL * normal(&mut self.rng));
            if outliers && self.rng.random_bool(OUTLIERS) {
                let eyes = [[0, 2], [2, 4], [0, 4]][self.rng.random_range(0..3)];
                for i in eyes[0]..eyes[1] {
                    pixels[i] = self.rng.random_range(0.0..[640.0, 480.0][i % 2]);
                }
            }
            let eye =
                |e: usize| Glimpse { center: [pixels[2 * e], pixels[2 * e + 1]], bounds: None, is_clipped: false };
            return KnownView { view: StereoView { eyes: [eye(0), eye(1)], encoders, is_timed: true }, place };
        }
    }

    /// Returns the covariance of the pixels of a view without outliers.
    fn scatter(&self, view: &KnownView) -> Option<Matrix4<f64>> {
        let mut all = Matrix4::identity() * PIXEL.powi(2);
        let seen = self.model.pixels(&view.view.encoders, &view.place)?;
        for joint in 3..9 {
            let mut moved = view.view.encoders;
            moved[joint] += BACKLASH;
            let by = self.model.pixels(&moved, &view.place)? - seen;
            all += by * by.transpose();
        }
        Some(all)
    }

    fn by_place(&self, view: &KnownView) -> Option<Matrix4x3<f64>> {
        let mut by = Matrix4x3::zeros();
        for i in 0..3 {
            let step = Vector3::from_fn(|k, _| if k == i { 1e-5 } else { 0.0 });
            let pixels = |place: Vector3<f64>| self.model.pixels(&view.view.encoders, &place);
            by.set_column(i, &((pixels(view.place + step)? - pixels(view.place - step)?) / 2e-5));
        }
        Some(by)
    }

    fn by_theta(&self, view: &KnownView) -> Option<DMatrix<f64>> {
        let mut by = DMatrix::zeros(4, self.model.theta.len());
        for i in 0..self.model.theta.len() {
            let moved = |step: f64| {
                let mut model = self.model.clone();
                model.theta[i] += step;
                model.pixels(&view.view.encoders, &view.place)
            };
            by.set_column(i, &((moved(1e-5)? - moved(-1e-5)?) / 2e-5));
        }
        Some(by)
    }

    /// Returns the least covariance of the parameters after these views without outliers.
    fn known_after(&self, honest: &[KnownView]) -> Option<DMatrix<f64>> {
        // No prior on the frame; there is no lag.
        let mut prior = deviations();
        prior[35..41].copy_from_slice(&[10.0; 6]);
        prior[41] = 1e-6;
        let mut information =
            DMatrix::from_diagonal(&DVector::from_iterator(prior.len(), prior.iter().map(|d| d.powi(-2))));
        for view in honest {
            let (by, scatter) = (self.by_theta(view)?, self.scatter(view)?.try_inverse()?);
            let scatter = DMatrix::from_column_slice(4, 4, scatter.as_slice());
            information += by.transpose() * scatter * by;
        }
        information.try_inverse()
    }

    /// Returns the least mean square error, m^2, of the positions of these views after training on
    /// those views without outliers.
    pub fn bound(&self, honest: &[KnownView], test: &[KnownView]) -> Option<f64> {
        let theta = self.known_after(honest)?;
        let mut sum = 0.0;
        for view in test {
            let (by, scatter) = (self.by_place(view)?, self.scatter(view)?.try_inverse()?);
            let of_place = (by.transpose() * scatter * by + Matrix3::identity() / 0.09).try_inverse()?;
            let gain = of_place * by.transpose() * scatter;
            let gain = DMatrix::from_column_slice(3, 4, gain.as_slice()) * self.by_theta(view)?;
            sum += of_place.trace() + (&gain * &theta * gain.transpose()).trace();
        }
        Some(sum / test.len() as f64)
    }
}

/// Accuracy of a head trained on views with outliers, and the best possible accuracy.
pub struct Learned {
    /// The head.
    pub head: SimulatedHead,
    /// The trained locator.
    pub calibrated: Calibrated,
    /// Mean square error on views of other positions without outliers, m^2.
    pub error: f64,
    /// Least possible mean square error, m^2.
    pub bound: f64,
}

/// Trains a head on this number of views.
pub fn learn(seed: u64, views: usize) -> Learned {
    let mut head = SimulatedHead::new(seed);
    let seen: Vec<KnownView> = (0..views).map(|_| head.view(true)).collect();
    let calibrated = Calibrated::train(&seen, &Beginning::recorded(seed), &mut |_| ()).expect("it learns");
    let test: Vec<KnownView> = (0..100).map(|_| head.view(false)).collect();
    let error = mean_square(&calibrated, &test);
    let honest: Vec<KnownView> = seen.into_iter().filter(|k| is_honest(&head, k)).collect();
    let bound = head.bound(&honest, &test).expect("a bound");
    Learned { head, calibrated, error, bound }
}

fn is_honest(head: &SimulatedHead, known: &KnownView) -> bool {
    let truth = head.model.pixels(&known.view.encoders, &known.place);
    truth.is_some_and(|t| (t - known.view.pixels()).norm() < 15.0)
}

/// Returns the mean square error on these views, m^2.
pub fn mean_square(calibrated: &Calibrated, test: &[KnownView]) -> f64 {
    let ready = calibrated.ready();
    let square = |k: &KnownView| ready.locate(&k.view).map_or(1.0, |e| (e.place - k.place).norm_squared());
    test.iter().map(square).sum::<f64>() / test.len() as f64
}
