//! How good a map is, from the places of its hand alone.

use std::collections::BTreeMap;

/// Figures of a map of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableMapFigures {
    /// How many poses have their nearest neighbor so many whole millimeters away, as the hand goes.
    pub nearest_mm: BTreeMap<u32, usize>,
    /// Median of these distances, meters.
    pub median: f64,
    /// The area that the poses stand for, each for a square of the median distance, square meters.
    pub area: f64,
}

/// Figures of hand positions, meters. Quadratic in their number at worst, nearly linear over a table.
pub fn figures(at: &[[f64; 3]]) -> TableMapFigures {
    // along x, so that only a strip is looked at
    let mut order: Vec<&[f64; 3]> = at.iter().collect();
    order.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut nearest: Vec<f64> = (0..order.len()).filter_map(|i| nearest_of(&order, i)).collect();
    nearest.sort_by(f64::total_cmp);
    let median = nearest.get(nearest.len() / 2).copied().unwrap_or(0.0);
    let mut nearest_mm = BTreeMap::new();
    for distance in &nearest {
        *nearest_mm.entry((distance * 1e3).floor() as u32).or_insert(0) += 1;
    }
    TableMapFigures { nearest_mm, median, area: at.len() as f64 * median * median }
}

/// How far the nearest other point is from the `i`th.
fn nearest_of(order: &[&[f64; 3]], i: usize) -> Option<f64> {
    let own = order.get(i)?;
    let mut least = f64::INFINITY;
    let mut look = |other: &[f64; 3]| {
        let square: f64 = own.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum();
        least = least.min(square.sqrt());
        (own[0] - other[0]).abs() > least
    };
    for other in order.iter().skip(i + 1) {
        if look(other) {
            break;
        }
    }
    for other in order.iter().take(i).rev() {
        if look(other) {
            break;
        }
    }
    least.is_finite().then_some(least)
}
