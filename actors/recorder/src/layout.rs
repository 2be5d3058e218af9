//! Position of a vertex in the flat drawing: that of the hand as seen from the front, but never on another
//! vertex. It is never moved later, so that an observer can track it.

/// Drawing units per meter.
const SCALE: f32 = 1000.0;
/// Least distance of two vertices, drawing units.
const MIN_DISTANCE: f32 = 55.0;
/// Steps of the spiral on which a free place is searched; each is a little further out.
const STEPS: usize = 4000;

/// Projection as seen from the front: `right` is the world's direction to the viewer's right, up is the world's
/// z.
pub(crate) fn project(at: [f32; 3], right: [f32; 3]) -> [f32; 2] {
    let x = at.iter().zip(&right).map(|(a, b)| a * b).sum::<f32>();
    let [_, _, z] = at;
    [SCALE * x, -SCALE * z]
}

/// The free place nearest to `wanted`, searched on a spiral around it.
pub(crate) fn place(wanted: [f32; 2], taken: &[[f32; 2]]) -> [f32; 2] {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let free = |p: &[f32; 2]| {
        taken.iter().all(|t| {
            let [dx, dy] = [t[0] - p[0], t[1] - p[1]];
            dx * dx + dy * dy >= MIN_DISTANCE * MIN_DISTANCE
        })
    };
    let [x, y] = wanted;
    let spiral = (0..STEPS).map(|i| {
        let turn = golden * i as f32;
        let out = 0.25 * MIN_DISTANCE * (i as f32).sqrt();
        [x + out * turn.cos(), y + out * turn.sin()]
    });
    spiral.into_iter().find(free).unwrap_or(wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn vertices_stay_apart_even_when_all_hands_are_at_one_place(
            at in prop::collection::vec((-0.02_f32..0.02, -0.02_f32..0.02), 1..120),
        ) {
            let mut taken: Vec<[f32; 2]> = Vec::new();
            for (x, z) in at {
                let p = place(project([0.3, x, z], [0.0, 1.0, 0.0]), &taken);
                for t in &taken {
                    prop_assert!((t[0] - p[0]).hypot(t[1] - p[1]) >= MIN_DISTANCE * 0.999);
                }
                taken.push(p);
            }
        }
    }

    #[test]
    fn what_is_higher_in_the_world_is_higher_on_the_screen() {
        let [low, high] = [0.1, 0.6].map(|z| project([0.0, 0.0, z], [0.0, 1.0, 0.0]));
        assert!(high[1] < low[1]);
    }
}
