//! The colors, in one place, so that legend and views agree.

use mobee_contract::{EdgeState, Outcome};
use mobee_model::{Object, ObjectClass};

/// A color as `0xRRGGBBAA`.
pub(crate) type Rgba = u32;

/// Shells of body parts, by the part's index: muted, and none close to red.
const PARTS: [Rgba; 6] = [0x8796AEFF, 0xE8DCC2FF, 0x5B9BD0FF, 0x5CB8A0FF, 0xA58BC8FF, 0xBFA95AFF];
/// A shape that is closer to another one than the reflex's margin.
pub(crate) const NEAR: Rgba = 0xF0322DFF;
/// A shape that touches or penetrates another one.
pub(crate) const HARD: Rgba = 0xFF00C8FF;
/// Places where contacts began so far.
pub(crate) const PAST_CONTACT: Rgba = 0xF0322DC0;
/// Vertices of the roadmap.
pub(crate) const VERTEX: Rgba = 0xE8ECF4FF;
/// The plan that is followed.
pub(crate) const PLAN: Rgba = 0xFF3B30FF;
/// An object that only the simulated world has.
pub(crate) const UNKNOWN: Rgba = 0xFF9A1FFF;
/// The frustum of a camera.
pub(crate) const FRUSTUM: Rgba = 0x6FE3FFA0;
/// The meshes that shapes were fitted to.
pub(crate) const MESH: Rgba = 0xB8BCC4FF;
/// Axis of the selected motor.
pub(crate) const AXIS: Rgba = 0xFFD34EFF;
/// No pair is near.
pub(crate) const FREE: Rgba = 0x4B7F5AFF;
/// Trails of markers, by index.
const TRAILS: [Rgba; 4] = [0xFFD34EFF, 0x6FE3FFFF, 0xFF9DF0FF, 0xB6FF7AFF];

/// Color of a body part's shapes.
pub(crate) fn part(index: usize) -> Rgba {
    PARTS.get(index % PARTS.len()).copied().unwrap_or(0x8796AEFF)
}

/// Color of a marker's trail.
pub(crate) fn trail(index: usize) -> Rgba {
    TRAILS.get(index % TRAILS.len()).copied().unwrap_or(0xFFD34EFF)
}

/// Lines of motors in a plot: clearly different from each other and from the dark background.
const SERIES: [Rgba; 18] = [
    0x4FA3FFFF, 0xFF8A3DFF, 0x52D273FF, 0xF2484BFF, 0xFFE14AFF, 0xC77DFFFF, 0x2EE6E6FF, 0xFF6FD0FF, 0xB07A45FF,
    0xC8F560FF, 0x8C96A8FF, 0xFFC9A3FF, 0x1E9E8AFF, 0x8F8FFFFF, 0xB03A6AFF, 0xA8E6CFFF, 0x6E8C1EFF, 0xFFFFFFFF,
];
/// Difference in hue between the additional lines of a larger plot, degrees: the golden angle, which never
/// repeats.
const NEXT_HUE: f32 = 137.508;

/// Color of a motor's line, by its index in the plot.
pub(crate) fn series(index: usize) -> Rgba {
    let Some(more) = index.checked_sub(SERIES.len()) else {
        return SERIES.get(index).copied().unwrap_or(0xFFFFFFFF);
    };
    // Three rings of lightness: similar hues differ in lightness.
    let hue = (NEXT_HUE * more as f32).rem_euclid(360.0);
    let value = [0.95, 0.75, 0.6][more % 3];
    let channel = |n: f32| {
        let k = (n + hue / 60.0).rem_euclid(6.0);
        let share = value - value * 0.65 * k.min(4.0 - k).clamp(0.0, 1.0);
        (255.0 * share) as u8
    };
    u32::from_be_bytes([channel(5.0), channel(3.0), channel(1.0), 255])
}

/// Edges of a map that no known object blocks.
pub(crate) const UNBLOCKED: Rgba = 0x35D07F70;
/// Edges that an object blocks, by the object's index.
const BLOCKERS: [Rgba; 5] = [0xF0322DFF, 0xFFD34EFF, 0xFF9DF0FF, 0x6FE3FFFF, 0xFF8A3DFF];

/// Color of edges that an object blocks.
pub(crate) fn blocker(index: usize) -> Rgba {
    BLOCKERS.get(index % BLOCKERS.len()).copied().unwrap_or(NEAR)
}

/// Color of an object: its own, or that of its class.
pub(crate) fn object(object: &Object) -> Rgba {
    let own = object.color.map(|[r, g, b]| u32::from_be_bytes([r, g, b, 255]));
    match object.class {
        ObjectClass::Obstacle => own.unwrap_or(0x9A7B5CFF),
        ObjectClass::Target => own.unwrap_or(0x4CD07DFF),
        ObjectClass::Ghost => own.unwrap_or(0xB9C4D6FF) & 0xFFFFFF00 | 0x48,
    }
}

/// Color of an edge, by its state.
pub(crate) fn edge(state: EdgeState) -> Rgba {
    match state {
        EdgeState::Feasible => 0x35D07FFF,
        EdgeState::Optimistic => 0x8A93A580,
        EdgeState::Doubtful => 0xE0A93CB0,
        EdgeState::Removed => 0xD8605A90,
        EdgeState::Blocked => 0xF0322DB0,
    }
}

/// Distance classes of two shapes of a model: value, label, color.
pub(crate) const NEARNESS: [(&str, &str, Rgba); 3] =
    [("free", "nothing near", FREE), ("near", "nearer than the margin", NEAR), ("touch", "shapes touch", HARD)];

/// Value of a distance (meters) in that lane; distances beyond the margin are infinite.
pub(crate) fn nearness(distance: f64) -> &'static str {
    match distance {
        d if d <= 0.0 => "touch",
        d if d.is_finite() => "near",
        _ => "free",
    }
}

/// States of a filter: value, label, color.
pub(crate) const FILTER: [(&str, &str, Rgba); 8] = [
    ("starting", "starting", 0x6B7280FF),
    ("rest", "at rest, open", 0x4B7F5AFF),
    ("moving", "moving", 0x3E8EDEFF),
    ("escaping", "escaping", 0x9B6BDFFF),
    ("stopping", "stopping", 0xF0322DFF),
    ("retreating", "retreating", 0xFF8A3DFF),
    ("settling", "settling", 0xE8C547FF),
    ("holding", "holding", 0xB0186CFF),
];

/// States of a transaction: value, label, color.
pub(crate) const TRANSACTION: [(&str, &str, Rgba); 4] = [
    ("open", "open", 0x3A5F8AFF),
    ("committed", "committed", 0x35B06FFF),
    ("rolled_back", "rolled back", 0xF0322DFF),
    ("faulted", "faulted", 0xB0186CFF),
];

/// Value of an outcome in its lane.
pub(crate) fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Committed => "committed",
        Outcome::RolledBack => "rolled_back",
        Outcome::Faulted => "faulted",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::Status;

    #[test]
    fn no_two_motors_of_a_part_have_lines_of_one_color() {
        let rgb = |c: Rgba| c.to_be_bytes().map(f64::from);
        let all: Vec<_> = (0..64).map(|i| rgb(series(i))).collect();
        for (i, a) in all.iter().enumerate() {
            assert!(a[..3].iter().sum::<f64>() > 250.0, "{i} is dark: {a:?}");
            for (k, b) in all.iter().enumerate().skip(i + 1) {
                let apart = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                // Parts with more motors than the iCub's arm are rare.
                let least = if k < 18 { 55.0 } else { 3.0 };
                assert!(apart >= least, "{i} and {k} are alike: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn every_state_has_its_entry_in_the_legend_of_its_lane() {
        let all = [
            Status::Starting,
            Status::Rest,
            Status::Moving,
            Status::Escaping,
            Status::Stopping,
            Status::Retreating,
            Status::Settling,
            Status::Holding(mobee_contract::Hold::InContact),
        ];
        for status in all {
            assert_eq!(FILTER.iter().filter(|(v, ..)| *v == status.word()).count(), 1, "{status:?}");
        }
        for end in [Outcome::Committed, Outcome::RolledBack, Outcome::Faulted] {
            assert_eq!(TRANSACTION.iter().filter(|(v, ..)| *v == outcome(end)).count(), 1, "{end:?}");
        }
    }
}
