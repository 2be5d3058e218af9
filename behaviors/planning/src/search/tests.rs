//! Properties of the strategies: a shift, scaling or rotation of the space, applied to the start as
//! well, gives the same run, and they converge in about as many evaluations as other
//! implementations of the same equations.

use super::*;
use nalgebra::{DMatrix, DVector};

const GENERATIONS: usize = 60;

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// Condition number 1e6, along the axes.
fn ellipsoid(x: &[f64]) -> f64 {
    let last = (x.len() - 1) as f64;
    x.iter().enumerate().map(|(i, x)| 1e6_f64.powf(i as f64 / last) * x * x).sum()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum()
}

/// Returns the means of a run, one for each generation.
fn run(mut search: impl EvolutionStrategy, f: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
    let mut points = Vec::new();
    let step = |_| {
        search.sample(&mut points);
        let fitness: Vec<f64> = points.chunks_exact(search.mean().len()).map(&f).collect();
        search.update(&fitness);
        search.mean().to_vec()
    };
    (0..GENERATIONS).map(step).collect()
}

/// Returns the number of evaluations until a sample is below 1e-8: the median of five seeds.
fn evaluations<S: EvolutionStrategy>(start: impl Fn(u64) -> S, f: fn(&[f64]) -> f64) -> usize {
    let one = |seed| {
        let (mut search, mut points, mut count) = (start(seed), Vec::new(), 0);
        while count < 60_000 {
            search.sample(&mut points);
            let fitness: Vec<f64> = points.chunks_exact(search.mean().len()).map(f).collect();
            count += fitness.len();
            if fitness.iter().any(|f| *f < 1e-8) {
                break;
            }
            search.update(&fitness);
        }
        count
    };
    let mut all: Vec<usize> = (1..=5).map(one).collect();
    all.sort_unstable();
    all[2]
}

fn xnes(mean: Vec<f64>, seed: u64) -> Xnes {
    let size = default_population(mean.len());
    Xnes::new(mean, 1.0, size, seed)
}

fn snes(mean: Vec<f64>, seed: u64) -> Snes {
    let size = default_population(mean.len());
    Snes::new(mean, 1.0, size, seed)
}

/// Checks that two runs are equal up to rounding, after transforming the second one back.
fn equal(a: &[Vec<f64>], b: &[Vec<f64>], back: impl Fn(&[f64]) -> Vec<f64>) {
    for (generation, (a, b)) in a.iter().zip(b).enumerate() {
        let b = back(b);
        let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-7, "generation {generation}: {a:?} and {b:?}");
    }
}

#[test]
fn a_shifted_and_scaled_function_is_searched_alike() {
    let shift = 3.0;
    let scale = 0.25;
    let there = |x: &[f64]| -> Vec<f64> { x.iter().map(|x| shift + scale * x).collect() };
    let back = |x: &[f64]| -> Vec<f64> { x.iter().map(|x| (x - shift) / scale).collect() };
    let start = vec![1.0; 5];
    let moved = |x: &[f64]| ellipsoid(&back(x));
    let other = Xnes::new(there(&start), scale, 8, 7);
    equal(&run(Xnes::new(start.clone(), 1.0, 8, 7), ellipsoid), &run(other, moved), back);
    let other = Snes::new(there(&start), scale, 8, 7);
    equal(&run(Snes::new(start.clone(), 1.0, 8, 7), ellipsoid), &run(other, moved), back);
}

#[test]
fn only_ranks_count() {
    let grown = |x: &[f64]| ellipsoid(x).ln() * 5.0 - 1000.0;
    assert_eq!(run(xnes(vec![1.0; 5], 3), ellipsoid), run(xnes(vec![1.0; 5], 3), grown));
    assert_eq!(run(snes(vec![1.0; 5], 3), ellipsoid), run(snes(vec![1.0; 5], 3), grown));
}

#[test]
fn a_turned_function_is_searched_alike_by_xnes() {
    // An arbitrary rotation in five dimensions: the orthogonal part of a matrix.
    let some = DMatrix::from_fn(5, 5, |i, j| ((3 * i + 7 * j * j) as f64).sin() + f64::from(u8::from(i == j)));
    let mut turn = some.qr().q();
    if turn.determinant() < 0.0 {
        turn.column_mut(0).neg_mut();
    }
    let back = |x: &[f64]| (turn.transpose() * DVector::from_column_slice(x)).as_slice().to_vec();
    let start = vec![1.0; 5];
    let there = (&turn * DVector::from_vec(start.clone())).as_slice().to_vec();
    let turned = Xnes::with_shape(there, 1.0, turn.clone(), 8, 7);
    equal(&run(Xnes::new(start, 1.0, 8, 7), ellipsoid), &run(turned, |x| ellipsoid(&back(x))), back);
}

/// Medians of five seeds from another implementation of these equations. Five other seeds differ by
/// a few percent, and on Rosenbrock's function by a third.
#[test]
fn they_converge_in_about_the_evaluations_of_the_equations() {
    let one = |d: usize| vec![1.0; d];
    let found = [
        ("xNES, sphere 5", evaluations(|seed| xnes(one(5), seed), sphere), 1496),
        ("SNES, sphere 5", evaluations(|seed| snes(one(5), seed), sphere), 880),
        ("xNES, ellipsoid 5", evaluations(|seed| xnes(one(5), seed), ellipsoid), 2256),
        ("SNES, ellipsoid 5", evaluations(|seed| snes(one(5), seed), ellipsoid), 1312),
        ("xNES, Rosenbrock 5", evaluations(|seed| xnes(vec![0.0; 5], seed), rosenbrock), 2888),
        ("xNES, sphere 10", evaluations(|seed| xnes(one(10), seed), sphere), 6120),
        ("SNES, sphere 10", evaluations(|seed| snes(one(10), seed), sphere), 1910),
        ("xNES, ellipsoid 10", evaluations(|seed| xnes(one(10), seed), ellipsoid), 9000),
        ("SNES, ellipsoid 10", evaluations(|seed| snes(one(10), seed), ellipsoid), 2690),
    ];
    let allowed = |name: &str, known: usize| known * if name.contains("Rosenbrock") { 35 } else { 8 } / 100;
    let far: Vec<_> = found.iter().filter(|(name, n, known)| n.abs_diff(*known) > allowed(name, *known)).collect();
    assert!(far.is_empty(), "{far:?} of {found:?}");
}

#[test]
fn a_generation_of_any_size_and_no_dimension_at_all_are_survived() {
    let mut points = Vec::new();
    for (d, size) in [(0, 0), (1, 1), (3, 5)] {
        let mut search = Snes::new(vec![0.0; d], 1.0, size, 1);
        search.sample(&mut points);
        search.update(&[f64::NAN]);
        assert_eq!(search.mean().len(), d);
    }
}
