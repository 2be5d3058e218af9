//! Search for few shapes close to the mesh: splits the worst piece while necessary, then merges pieces that one shape
//! can hold.

use super::FitOptions;
use super::enclose::principal_axes;
use super::filled::Filled;
use super::piece::{self, CoverFit, Piece, spread};
use super::soup::{Soup, Triangle, split};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Approximate number of points that represent the surface while planes are tried.
const SAMPLES: f64 = 2500.0;
/// Positions of the planes to try, as fractions of a piece's extent along an axis.
const CUTS: [f64; 7] = [0.12, 0.25, 0.37, 0.5, 0.63, 0.75, 0.88];
/// Minimum extent for a split, meters.
const MIN_EXTENT_M: f64 = 1e-3;
/// Number of pieces beyond the limit before merging.
const EXTRA_PIECES: usize = 10;
/// Number of rounds in which released triangles make room for more splits.
const RELEASE_ROUNDS: usize = 2;
/// Fraction of the bound that a search aims for, since it measures at few points.
const BOUND_FRACTION: f64 = 0.9;

/// Covers all triangles with shapes: the best result of several searches.
pub(super) fn cover(soup: &Soup, filled: &Filled, options: &FitOptions) -> Vec<Piece> {
    let mut best: Option<(f64, Vec<Piece>)> = None;
    let parts = soup.connected().len();
    for plan in PLANS.iter().filter(|p| p.connected || parts > 1) {
        let pieces = search(soup, filled, options, *plan);
        let cost = total(&pieces, options);
        // A cover by a single shape can't be improved.
        let simple = pieces.len() < 2;
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, pieces));
        }
        if simple {
            break;
        }
    }
    best.map_or(Vec::new(), |(_, pieces)| pieces)
}

/// Parameters of a search: greedy choices that suit one mesh do not suit another.
#[derive(Clone, Copy)]
pub(super) struct Plan {
    /// If true, the search starts from the connected parts of the mesh.
    connected: bool,
    /// Weight of the mean cost of both sides of a plane, compared with that of the worse side.
    sides: f64,
}

/// The plans that are tried.
pub(super) const PLANS: [Plan; 3] =
    [Plan { connected: true, sides: 1.0 }, Plan { connected: true, sides: 0.0 }, Plan { connected: false, sides: 1.0 }];

/// Runs one search.
fn search(soup: &Soup, filled: &Filled, options: &FitOptions, plan: Plan) -> Vec<Piece> {
    let bound = options.overshoot * BOUND_FRACTION;
    let count = options.primitives.max(1);
    let mut pieces = start(soup, filled, count, plan);
    // Greedy planes are not optimal: from surplus pieces, merged again, the boundaries that matter remain.
    split_all(&mut pieces, count + EXTRA_PIECES, bound, plan, filled);
    merge_all(&mut pieces, count, bound, filled);
    for _ in 0..RELEASE_ROUNDS {
        release_all(&mut pieces, filled);
        split_all(&mut pieces, count, bound, plan, filled);
    }
    merge_all(&mut pieces, count, bound, filled);
    pieces
}

/// Cost of a cover, meters: the bound has priority, then free space and few shapes.
fn total(pieces: &[Piece], options: &FitOptions) -> f64 {
    let worst = pieces.iter().map(|p| p.fit.worst).fold(0.0, f64::max);
    let samples: usize = pieces.iter().map(|p| p.samples.len()).sum();
    let mean: f64 = pieces.iter().map(|p| p.fit.mean * p.samples.len() as f64).sum();
    let share = pieces.len() as f64 / options.primitives.max(1) as f64;
    worst.max(options.overshoot) + mean / samples.max(1) as f64 + 0.1 * options.overshoot * share
}

/// Moves triangles to other pieces whose shapes contain them anyway, if the piece's own shape then gets tighter.
/// Removes pieces that become empty.
fn release_all(pieces: &mut Vec<Piece>, filled: &Filled) {
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by(|a, b| pieces[*b].fit.cost.total_cmp(&pieces[*a].fit.cost));
    let mut gone = vec![false; pieces.len()];
    for this in order {
        let holder = |t: &Triangle| {
            (0..pieces.len()).find(|i| *i != this && !gone[*i] && t.iter().all(|p| pieces[*i].fit.cover.contains(p)))
        };
        let piece = &pieces[this];
        let held: Vec<Option<usize>> = piece.triangles.iter().map(holder).collect();
        if held.iter().all(Option::is_none) {
            continue;
        }
        let own = piece.triangles.iter().zip(&held).filter(|(_, h)| h.is_none()).map(|(t, _)| *t).collect::<Vec<_>>();
        let outside = |p: &Vector3<f64>| holder(&[*p; 3]).is_none();
        let samples: Vec<Vector3<f64>> = piece.samples.iter().filter(|p| outside(p)).copied().collect();
        let like = piece.fit.cover.pose.rotation;
        let smaller = Piece::new(own, samples, &like, filled);
        if smaller.as_ref().is_some_and(|s| s.fit.cost >= piece.fit.cost) {
            continue;
        }
        let released: Vec<(usize, Triangle)> =
            piece.triangles.iter().zip(&held).filter_map(|(t, h)| Some(((*h)?, *t))).collect();
        let mut changed = BTreeSet::new();
        for (to, triangle) in released {
            pieces[to].triangles.push(triangle);
            changed.insert(to);
        }
        changed.into_iter().for_each(|i| {
            pieces[i].extremes = piece::extremes(piece::DIRECTIONS, pieces[i].triangles.iter().flatten())
        });
        match smaller {
            Some(smaller) => pieces[this] = smaller,
            None => gone[this] = true,
        }
    }
    let mut gone = gone.into_iter();
    pieces.retain(|_| !gone.next().unwrap_or(false));
}

/// The connected parts of the mesh, or all of it if they are too many.
fn start(soup: &Soup, filled: &Filled, count: usize, plan: Plan) -> Vec<Piece> {
    let mut parts = soup.connected();
    if !plan.connected || parts.len() > 2 * count {
        parts = vec![soup.triangles.clone()];
    }
    let total: f64 = soup.triangles.iter().map(area).sum();
    let piece = |triangles: Vec<Triangle>| {
        let samples = samples(&triangles, total, SAMPLES);
        Piece::new(triangles, samples, &UnitQuaternion::identity(), filled)
    };
    parts.into_iter().filter_map(piece).collect()
}

/// The area of a triangle, square meters.
pub(super) fn area([a, b, c]: &Triangle) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Points distributed evenly over triangles, at a density of `count` per `total` area.
pub(super) fn samples(triangles: &[Triangle], total: f64, count: f64) -> Vec<Vector3<f64>> {
    let mut out = Vec::new();
    let mut due = 0.0;
    for triangle @ [a, b, c] in triangles {
        due += area(triangle) / total.max(f64::MIN_POSITIVE) * count;
        while due >= 1.0 {
            due -= 1.0;
            // Powers of the plastic number distribute points evenly over a square (Roberts 2018); folding maps them to
            // a triangle.
            let n = out.len() as f64;
            let u = (n * 0.754_877_666_246_692_8).fract();
            let v = (n * 0.569_840_290_998_053_2).fract();
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            out.push(a + (b - a) * u + (c - a) * v);
        }
    }
    out
}

/// Splits the worst piece until all are within the bound or there are `count` pieces.
fn split_all(pieces: &mut Vec<Piece>, count: usize, bound: f64, plan: Plan, filled: &Filled) {
    // Small pieces that no plane splits.
    let mut whole = BTreeSet::new();
    while pieces.len() < count {
        let beyond = (0..pieces.len()).filter(|i| pieces[*i].fit.worst > bound && !whole.contains(i));
        let Some(worst) = beyond.max_by(|a, b| pieces[*a].fit.worst.total_cmp(&pieces[*b].fit.worst)) else {
            return;
        };
        let piece = &pieces[worst];
        if let Some((low, high)) = halves(piece, plan, filled) {
            pieces[worst] = low;
            pieces.push(high);
        } else {
            whole.insert(worst);
        }
    }
}

/// Splits a piece at the best plane.
pub(super) fn halves(piece: &Piece, plan: Plan, filled: &Filled) -> Option<(Piece, Piece)> {
    let (normal, at) = best_plane(piece, plan, filled)?;
    halves_at(piece, &normal, at, filled)
}

/// Splits a piece at a plane.
pub(super) fn halves_at(piece: &Piece, normal: &Vector3<f64>, at: f64, filled: &Filled) -> Option<(Piece, Piece)> {
    let like = piece.fit.cover.pose.rotation;
    let [low, high] = parts(piece, normal, at);
    Piece::new(low.0, low.1, &like, filled).zip(Piece::new(high.0, high.1, &like, filled))
}

/// Candidate planes for splitting a piece, each as its normal and its offset along that: perpendicular to the axes of
/// its shape and of the link.
pub(super) fn planes(piece: &Piece) -> impl Iterator<Item = (Vector3<f64>, f64)> {
    normals(piece).into_iter().flat_map(|normal| {
        let (low, high) = extent(piece, &normal);
        let cuts = CUTS.into_iter().filter(move |_| high - low >= MIN_EXTENT_M);
        cuts.map(move |cut| (normal, low + cut * (high - low)))
    })
}

/// The directions of the axes of a piece's shape, and the link's axes that differ from them.
fn normals(piece: &Piece) -> Vec<Vector3<f64>> {
    let turn = piece.fit.cover.pose.rotation;
    let mut axes: Vec<Vector3<f64>> = (0..3).map(|i| turn * Vector3::ith(i, 1.0)).collect();
    let own = (0..3).map(|i| Vector3::ith(i, 1.0));
    let new = own.filter(|a: &Vector3<f64>| axes.iter().all(|b| a.dot(b).abs() < 0.99)).collect::<Vec<_>>();
    axes.extend(new);
    axes
}

/// Minimum and maximum of a piece along a direction, meters.
fn extent(piece: &Piece, along: &Vector3<f64>) -> (f64, f64) {
    let places = piece.extremes.iter().map(|p| along.dot(p));
    places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
}

/// Triangles and samples on each side of a plane.
fn parts(piece: &Piece, normal: &Vector3<f64>, at: f64) -> [(Vec<Triangle>, Vec<Vector3<f64>>); 2] {
    let mut low = Vec::new();
    let mut high = Vec::new();
    piece.triangles.iter().for_each(|t| split(t, normal, at, &mut low, &mut high));
    let (below, above) = piece.samples.iter().partition(|p| normal.dot(p) <= at);
    [(low, below), (high, above)]
}

/// The plane with the cheapest two sides, judged by samples.
fn best_plane(piece: &Piece, plan: Plan, filled: &Filled) -> Option<(Vector3<f64>, f64)> {
    let turn = piece.fit.cover.pose.rotation;
    let points: Vec<Vector3<f64>> = piece.samples.iter().chain(&piece.extremes).copied().collect();
    let mut best: Option<(f64, Vector3<f64>, f64, f64)> = None;
    let attempt = |normal: &Vector3<f64>, at: f64, least: f64| {
        let (below, above): (Vec<_>, Vec<_>) = points.iter().partition(|p| normal.dot(p) <= at);
        let a = side(&below, &turn, filled)?;
        if a.cost >= least {
            return None;
        }
        let b = side(&above, &turn, filled)?;
        let share = below.len() as f64 / points.len() as f64;
        let mean = |f: fn(&CoverFit) -> f64| f(&a) * share + f(&b) * (1.0 - share);
        Some(a.cost.max(b.cost) + mean(|t| t.mean) + plan.sides * mean(|t| t.cost))
    };
    for normal in normals(piece) {
        let (low, high) = extent(piece, &normal);
        if high - low < MIN_EXTENT_M {
            continue;
        }
        for share in CUTS {
            let at = low + (high - low) * share;
            let least = best.map_or(f64::INFINITY, |(least, ..)| least);
            if let Some(cost) = attempt(&normal, at, least)
                && cost < least
            {
                best = Some((cost, normal, at, high - low));
            }
        }
    }
    for step in [0.06, 0.03, 0.015] {
        let (_, normal, at, extent) = best?;
        for at in [at - step * extent, at + step * extent] {
            let least = best.map_or(f64::INFINITY, |(least, ..)| least);
            if let Some(cost) = attempt(&normal, at, least)
                && cost < least
            {
                best = Some((cost, normal, at, extent));
            }
        }
    }
    best.map(|(_, normal, at, _)| (normal, at))
}

/// Approximate enclosing shape of the points on one side of a plane.
fn side(points: &[Vector3<f64>], turn: &UnitQuaternion<f64>, filled: &Filled) -> Option<CoverFit> {
    let extremes = piece::extremes(piece::DIRECTIONS, points.iter());
    piece::best(&extremes, &[*turn, principal_axes(spread(points, &extremes))], filled)
}

/// Merges pairs of pieces while one shape within the bound holds both, and further until there are at most `count`.
fn merge_all(pieces: &mut Vec<Piece>, count: usize, bound: f64, filled: &Filled) {
    // Cost of one shape around each pair; only pairs with a new piece are evaluated again.
    let mut known: BTreeMap<(usize, usize), CoverFit> = BTreeMap::new();
    let mut alive: Vec<Option<Piece>> = std::mem::take(pieces).into_iter().map(Some).collect();
    let mut new: Vec<usize> = (0..alive.len()).collect();
    loop {
        for &a in &new {
            for b in 0..alive.len() {
                let (a, b) = (a.min(b), a.max(b));
                if a != b
                    && let (Some(p), Some(q)) = (&alive[a], &alive[b])
                    && !known.contains_key(&(a, b))
                {
                    known.extend(together(p, q, filled).map(|t| ((a, b), t)));
                }
            }
        }
        let crowded = alive.iter().flatten().count() > count;
        let fits = known.iter().filter(|(_, t)| crowded || t.worst <= bound * 0.95);
        let Some((&(a, b), _)) = fits.min_by(|x, y| x.1.cost.total_cmp(&y.1.cost)) else { break };
        known.retain(|(i, j), _| ![*i, *j].iter().any(|k| *k == a || *k == b));
        let merged = alive[a].take().zip(alive[b].take()).and_then(|(first, second)| first.merged(second, filled));
        alive.push(merged);
        new = vec![alive.len() - 1];
    }
    pieces.extend(alive.into_iter().flatten());
}

/// Approximate enclosing shape of two pieces.
fn together(a: &Piece, b: &Piece, filled: &Filled) -> Option<CoverFit> {
    let points: Vec<Vector3<f64>> = a.extremes.iter().chain(&b.extremes).copied().collect();
    piece::best(&points, &[a, b].map(|p| p.fit.cover.pose.rotation), filled)
}
