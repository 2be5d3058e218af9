//! Boxes contain what moves: for robots with revolute and prismatic joints and fingers, on long
//! motions and short ones.

use super::{Limbs, bounds};
use mobee_model::{Scene, load_robot, random_poses};
use nalgebra::Isometry3;
use std::path::Path;
use std::sync::Arc;

/// Number of configurations sampled on each motion.
const SAMPLES: usize = 60;

#[test]
fn every_shape_is_in_a_box_at_every_pose_of_a_way() {
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots");
    for (file, every, most) in [("icub", 3, 2.0), ("katana", 1, 2.0), ("panda", 1, 2.5), ("ur5", 2, 3.0)] {
        let robot = Arc::new(load_robot(robots.join(file).with_extension("xml")).unwrap().value);
        // An arbitrary pose.
        let base = Isometry3::new([0.3, -0.2, 0.1].into(), [0.2, -0.4, 0.9].into());
        let scene = Scene::new(vec![(robot.clone(), base)], Vec::new()).unwrap();
        // Not all motors, so that some links form one rigid body.
        let motors: Vec<usize> = (0..robot.motors.len()).step_by(every).collect();
        let group = |q: &[f64]| motors.iter().map(|m| q[*m]).collect::<Vec<_>>();
        let poses: Vec<Vec<f64>> = random_poses(&robot, 3).take(13).collect();
        let rest = &poses[0];
        let limbs = Limbs::new(&scene, 0, &motors, rest);
        let carried = limbs.carried(&scene);
        let mut looseness: f64 = 0.0;
        for (i, pair) in poses.windows(2).enumerate() {
            // From a hundredth of the motion to all of it.
            let share = [0.01, 0.1, 1.0][i % 3];
            let from = group(&pair[0]);
            let to = group(&pair[1]);
            let to: Vec<f64> = from.iter().zip(&to).map(|(a, b)| a + (b - a) * share).collect();
            let mut boxes = Vec::new();
            limbs.sweep(&from, &to, &mut boxes);
            assert_eq!(boxes.len(), limbs.len());
            for sample in 0..=SAMPLES {
                let s = sample as f64 / SAMPLES as f64;
                let mut q = rest.clone();
                motors.iter().enumerate().for_each(|(i, m)| q[*m] = from[i] + (to[i] - from[i]) * s);
                let mut frames = Vec::new();
                scene.skeletons()[0].place(&q, &mut frames);
                for (collider, _) in scene.colliders().zip(&carried).filter(|(_, body)| **body > 0) {
                    let (low, high) = bounds(collider.shape, &(frames[collider.frame] * collider.pose));
                    let holds = |b: &&[f32; 6]| {
                        (0..3).all(|k| f64::from(b[k]) <= low[k] + 1e-9 && high[k] - 1e-9 <= f64::from(b[k + 3]))
                    };
                    let holder =
                        boxes.iter().filter(holds).map(|b| (0..3).map(|k| b[k + 3] - b[k]).fold(0.0, f32::max));
                    let smallest = holder.fold(f32::INFINITY, f32::min);
                    assert!(smallest.is_finite(), "{file}: a shape leaves its box at {s} of way {i}");
                    looseness = looseness.max(f64::from(smallest));
                }
            }
        }
        assert!(looseness < most, "{file}: a box of {looseness} m says little");
    }
}
