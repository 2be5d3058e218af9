//! The colors, in one place, so that the legend can't tell a different story.

use mobee_contract::{EdgeState, Outcome};
use mobee_model::{Object, ObjectClass};

/// A color as `0xRRGGBBAA`.
pub(crate) type Rgba = u32;

/// Shells of body parts, by the part's index; muted, and none near red.
const PARTS: [Rgba; 6] = [0x8796AEFF, 0xE8DCC2FF, 0x5B9BD0FF, 0x5CB8A0FF, 0xA58BC8FF, 0xBFA95AFF];
/// A shape nearer to another one than the margin of the reflex.
pub(crate) const NEAR: Rgba = 0xF0322DFF;
/// A shape that touches or penetrates another one.
pub(crate) const HARD: Rgba = 0xFF00C8FF;
/// Places where contacts began so far.
pub(crate) const PAST_CONTACT: Rgba = 0xF0322DC0;
/// Vertices of the roadmap.
pub(crate) const VERTEX: Rgba = 0xE8ECF4FF;
/// The plan that is followed.
pub(crate) const PLAN: Rgba = 0xFF3B30FF;
/// The frustum of a camera.
pub(crate) const FRUSTUM: Rgba = 0x6FE3FFA0;
/// The meshes that shapes were fitted to.
pub(crate) const MESH: Rgba = 0xB8BCC4FF;
/// The axis of the motor that is looked at.
pub(crate) const AXIS: Rgba = 0xFFD34EFF;
/// Nothing is near.
pub(crate) const FREE: Rgba = 0x4B7F5AFF;
/// Trails of markers, by index.
const TRAILS: [Rgba; 4] = [0xFFD34EFF, 0x6FE3FFFF, 0xFF9DF0FF, 0xB6FF7AFF];

/// The color of a body part's shapes.
pub(crate) fn part(index: usize) -> Rgba {
    PARTS.get(index % PARTS.len()).copied().unwrap_or(0x8796AEFF)
}

/// The color of a marker's trail.
pub(crate) fn trail(index: usize) -> Rgba {
    TRAILS.get(index % TRAILS.len()).copied().unwrap_or(0xFFD34EFF)
}

/// Edges of a map that nothing is known to block.
pub(crate) const UNBLOCKED: Rgba = 0x35D07F70;
/// Edges that something blocks, by its index.
const BLOCKERS: [Rgba; 5] = [0xF0322DFF, 0xFFD34EFF, 0xFF9DF0FF, 0x6FE3FFFF, 0xFF8A3DFF];

/// The color of edges that something blocks.
pub(crate) fn blocker(index: usize) -> Rgba {
    BLOCKERS.get(index % BLOCKERS.len()).copied().unwrap_or(NEAR)
}

/// The color of an object: its own, or what its class says.
pub(crate) fn object(object: &Object) -> Rgba {
    let own = object.color.map(|[r, g, b]| u32::from_be_bytes([r, g, b, 255]));
    match object.class {
        ObjectClass::Obstacle => own.unwrap_or(0x9A7B5CFF),
        ObjectClass::Target => own.unwrap_or(0x4CD07DFF),
        ObjectClass::Ghost => own.unwrap_or(0xB9C4D6FF) & 0xFFFFFF00 | 0x48,
    }
}

/// The color of an edge by what is believed of it.
pub(crate) fn edge(state: EdgeState) -> Rgba {
    match state {
        EdgeState::Feasible => 0x35D07FFF,
        EdgeState::Optimistic => 0x8A93A580,
        EdgeState::Doubtful => 0xE0A93CB0,
        EdgeState::Removed => 0xD8605A90,
        EdgeState::Blocked => 0xF0322DB0,
    }
}

/// How near two shapes of a model are: value, words, color.
pub(crate) const NEARNESS: [(&str, &str, Rgba); 3] =
    [("free", "nothing near", FREE), ("near", "nearer than the margin", NEAR), ("touch", "shapes touch", HARD)];

/// The value of a distance in that lane, meters; what is farther than the margin counts as infinite.
pub(crate) fn nearness(distance: f64) -> &'static str {
    match distance {
        d if d <= 0.0 => "touch",
        d if d.is_finite() => "near",
        _ => "free",
    }
}

/// The states of a filter: value, words, color.
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

/// The states of a transaction: value, words, color.
pub(crate) const TRANSACTION: [(&str, &str, Rgba); 4] = [
    ("open", "open", 0x3A5F8AFF),
    ("committed", "committed", 0x35B06FFF),
    ("rolled_back", "rolled back", 0xF0322DFF),
    ("faulted", "faulted", 0xB0186CFF),
];

/// The value of an outcome in its lane.
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
