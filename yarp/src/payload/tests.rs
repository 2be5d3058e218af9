use proptest::prelude::*;

use super::*;
use crate::{Bottle, Dialect, Vocab};

#[test]
fn an_envelope_has_a_count_and_a_time() {
    let stamp = Stamp { count: 2788, time: 1795226722.01733 };
    assert_eq!(stamp.envelope(), "2788 1795226722.01733");
    assert_eq!(Stamp::from_envelope("2788 1795226722.01733"), Some(stamp));
    assert_eq!(Stamp::from_envelope("3 1.5 frame"), Some(Stamp { count: 3, time: 1.5 }));
    assert_eq!(Stamp::from_envelope("3 2"), Some(Stamp { count: 3, time: 2.0 }));
    for no in ["", "x 1.0", "1", "-1 2.0", "1 nan", "9999999999 1.0"] {
        assert_eq!(Stamp::from_envelope(no), None, "{no}");
    }
    assert_eq!(Stamp { count: i32::MAX.unsigned_abs(), time: 0.0 }.next(1.0).count, 0);
}

#[test]
fn what_is_no_pair_is_refused() {
    // the flat bottle that makes YARP's own reader hang
    let flat = Bottle::new().with(Vocab::new("vmos")).with(Bottle::of([0.0, 0.0]));
    assert!(pair::decode(&flat.encode(Dialect::V3), Dialect::V3).is_err());
    for text in ["", "(a)", "(a) (b)", "(a) 1", "(a) (1) (2)"] {
        assert!(pair::from_bottle(&Bottle::parse(text, Dialect::V3).unwrap()).is_err(), "{text}");
    }
    // an empty body keeps its type
    let bytes = pair::encode(&Bottle::new(), &[], Dialect::V3);
    assert_eq!(bytes[16..20], 266i32.to_le_bytes());
    assert_eq!(pair::decode(&bytes, Dialect::V3), Ok((Bottle::new(), vec![])));
}

#[test]
fn sizes_that_disagree_are_no_image() {
    let good = "[mat] [rgb] (3 16 65544 3 1) {1 2 3 4 5 6 7 8 9 0 0 0 0 0 0 0}";
    let image = |text: &str| Image::from_bottle(Bottle::parse(text, Dialect::V3).unwrap());
    assert_eq!(image(good).unwrap().pixels(), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
    for (right, wrong) in [
        ("[mat]", "[map]"),
        ("[rgb]", "[xyz]"),
        ("[rgb]", "[mono]"),
        ("(3 ", "(4 "),
        (" 16 ", " 15 "),
        ("65544", "65536"),
        (" 3 1)", " 4 2)"),
        (" 3 1)", " -3 -1)"),
        (" 3 1)", " 2147483647 2147483647)"),
        (" 0}", "}"),
    ] {
        assert!(image(&good.replacen(right, wrong, 1)).is_err(), "{right} as {wrong}");
    }
}

proptest! {
    #[test]
    fn an_image_of_any_pixels_comes_back(
        code in 0..PixelCode::ALL.len(),
        width in 0u32..9,
        height in 0u32..9,
        seed: Vec<u8>,
    ) {
        let (pixel, bytes) = PixelCode::ALL[code];
        let count = usize::try_from(width * height).unwrap() * bytes;
        let pixels: Vec<u8> = seed.iter().chain(&[7]).copied().cycle().take(count).collect();
        let image = Image::new(pixel, width, height, &pixels).unwrap();
        prop_assert_eq!(&Image::decode(&image.encode(), Dialect::V3).unwrap(), &image);
        prop_assert_eq!(&Image::from_bottle(image.to_bottle()).unwrap(), &image);
        prop_assert_eq!(image.pixels(), pixels);
        prop_assert_eq!(image.rows.len() % 8, 0);
    }

    #[test]
    fn joint_data_comes_back(axes in 0usize..5, valid: [bool; 12], x in -1e3f32..1e3) {
        let float = |i: usize| JointField { values: (0..axes).map(|j| f64::from(x) + (i * j) as f64 * 0.0).collect(), valid: valid[i] };
        let mode = |i: usize| JointField { values: vec![i as i32 - 5; axes], valid: valid[i] };
        let data = JointData {
            position: float(0), velocity: float(1), acceleration: float(2), motor_position: float(3),
            motor_velocity: float(4), motor_acceleration: float(5), torque: float(6), pwm: float(7), current: float(8),
            control_modes: mode(9), interaction_modes: mode(10), temperature: JointField::default(),
        };
        prop_assert_eq!(&JointData::decode(&data.encode(Dialect::V3), Dialect::V3).unwrap(), &data);
        let data = JointData { temperature: float(11), ..data };
        prop_assert_eq!(&JointData::decode(&data.encode(Dialect::V4), Dialect::V4).unwrap(), &data);
    }

    #[test]
    fn pairs_come_back(words in prop::collection::vec(any::<i32>(), 0..4), body in prop::collection::vec(-1e9..1e9f64, 0..20)) {
        let head = Bottle::of(words);
        for dialect in [Dialect::V3, Dialect::V4] {
            let back = pair::decode(&pair::encode(&head, &body, dialect), dialect).unwrap();
            prop_assert_eq!(back, (head.clone(), body.clone()));
        }
        let text = pair::to_bottle(&head, &body).to_text();
        prop_assert_eq!(pair::from_bottle(&Bottle::parse(text, Dialect::V3).unwrap()).unwrap(), (head, body));
    }
}
