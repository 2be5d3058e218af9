//! Figures of a map, from its hand positions alone.

use std::collections::BTreeMap;

/// Figures of a map of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TableMapFigures {
    /// Number of poses by the distance to their nearest neighbor, measured at the hand, in whole
    /// millimeters.
    pub nearest_mm: BTreeMap<u32, usize>,
    /// Median of these distances, meters.
    pub median: f64,
    /// Covered area, square meters: a square of the median distance for each pose.
    pub area: f64,
}

/// Computes the figures of hand positions, meters. Quadratic in their number at worst, nearly
/// linear over a table.
pub fn figures(at: &[[f64; 3]]) -> TableMapFigures {
    // Sorted along x, so that only a strip is searched.
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

/// Returns the distance of the nearest other point from the `i`th.
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
