//! Detections in one image as a bottle: for a locator in another process, and for any YARP program.
//!
//! ```text
//! (size W H) (focal FX FY) (center CX CY) (distortion K1 K2 P1 P2) (regions REGION ...)
//! REGION = (NAME (center U V) (bounds LEFT TOP RIGHT BOTTOM) (area A) (clipped 0|1) (confidence C) [POSE])
//! POSE   = (position X Y Z) (rotation W X Y Z) (covariance 36 numbers, row by row)
//! ```
//! Lengths in images are in pixels from the upper left corner, those in space in meters (x right, y down, z
//! forward). The envelope is a stamp: the number of the message, and the time of day at which the image was
//! exposed, s since 1970. Lists may come in any order, and unknown ones are ignored.

use super::words::{exactly, integer, name, number, string};
use mobee_contract::{Intrinsics, Region, SeenPose};
use mobee_yarp::{Bottle, Value};

/// Largest number of regions in one image.
const MAX_REGIONS: usize = 256;
/// Greatest width and height of an image, pixels.
const MAX_SIDE_PX: i64 = 16_384;

/// Detections in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenRegions {
    /// Projection of the camera.
    pub intrinsics: Intrinsics,
    /// Regions that the detector found.
    pub regions: Vec<Region>,
}

impl SeenRegions {
    /// Converts to a bottle.
    pub fn bottle(&self) -> Bottle {
        let Intrinsics { size, focal, center, distortion } = self.intrinsics;
        let size = size.map(|n| Value::Int32(i32::try_from(n).unwrap_or(i32::MAX)));
        let regions = self.regions.iter().map(|r| Value::List(of_region(r)));
        Bottle(vec![
            list("size", size),
            list("focal", floats(focal)),
            list("center", floats(center)),
            list("distortion", floats(distortion)),
            list("regions", regions),
        ])
    }

    /// Parses a bottle.
    ///
    /// # Errors
    /// A list that is missing or invalid; the whole bottle is rejected then.
    pub fn parse(bottle: &Bottle) -> Result<SeenRegions, String> {
        let size = find(bottle, "size").and_then(|rest| match rest {
            [w, h] => Some([side(w)?, side(h)?]),
            _ => None,
        });
        let intrinsics = Intrinsics {
            size: size.ok_or_else(|| misses("size", "two whole numbers of pixels"))?,
            focal: numbers(bottle, "focal")?,
            center: numbers(bottle, "center")?,
            distortion: numbers(bottle, "distortion")?,
        };
        if intrinsics.focal.iter().any(|f| *f <= 0.0) {
            return Err(misses("focal", "two lengths above zero"));
        }
        let regions = find(bottle, "regions").ok_or_else(|| misses("regions", "a list for each region"))?;
        if regions.len() > MAX_REGIONS {
            return Err(format!("{} regions in one picture are more than {MAX_REGIONS}", regions.len()));
        }
        let read = |(k, value): (usize, &Value)| {
            let region = value.as_list().ok_or_else(|| "it is no list".to_owned()).and_then(region);
            region.map_err(|why| format!("region {}: {why}", k + 1))
        };
        let regions = regions.iter().enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(SeenRegions { intrinsics, regions })
    }
}

fn of_region(r: &Region) -> Bottle {
    let mut lists = vec![
        string(&r.object),
        list("center", floats(r.center)),
        list("bounds", floats(r.bounds)),
        list("area", floats([r.area])),
        list("clipped", [Value::Int32(i32::from(r.is_clipped))]),
        list("confidence", floats([r.confidence])),
    ];
    if let Some(pose) = &r.pose {
        lists.push(list("position", floats(pose.position)));
        lists.push(list("rotation", floats(pose.rotation)));
        lists.push(list("covariance", floats(pose.covariance.iter().flatten().copied())));
    }
    Bottle(lists)
}

fn region(bottle: &Bottle) -> Result<Region, String> {
    let object = name(bottle.get(0)).filter(|name| !name.is_empty());
    let [area] = numbers(bottle, "area")?;
    let [confidence] = numbers(bottle, "confidence")?;
    let clipped = find(bottle, "clipped").and_then(|rest| integer(rest.first()));
    let pose = match find(bottle, "position") {
        None => None,
        Some(_) => {
            let covariance: [f64; 36] = numbers(bottle, "covariance")?;
            let mut rows = [[0.0; 6]; 6];
            rows.iter_mut().flatten().zip(covariance).for_each(|(to, from)| *to = from);
            let position = numbers(bottle, "position")?;
            let rotation = numbers(bottle, "rotation")?;
            Some(SeenPose { position, rotation, covariance: rows })
        }
    };
    Ok(Region {
        object: object.ok_or("it does not begin with an object's name")?,
        center: numbers(bottle, "center")?,
        bounds: numbers(bottle, "bounds")?,
        area,
        is_clipped: clipped.ok_or_else(|| misses("clipped", "0 or 1"))? != 0,
        confidence,
        pose,
    })
}

fn list(key: &str, rest: impl IntoIterator<Item = Value>) -> Value {
    Value::List(Bottle(std::iter::once(string(key)).chain(rest).collect()))
}

fn floats(numbers: impl IntoIterator<Item = f64>) -> impl Iterator<Item = Value> {
    numbers.into_iter().map(Value::Float64)
}

/// Rest of the list that begins with a key.
fn find<'a>(bottle: &'a Bottle, key: &str) -> Option<&'a [Value]> {
    let mut lists = bottle.0.iter().filter_map(Value::as_list);
    lists.find(|list| name(list.get(0)).is_some_and(|found| found == key)).and_then(|list| list.0.get(1..))
}

fn numbers<const N: usize>(bottle: &Bottle, key: &str) -> Result<[f64; N], String> {
    find(bottle, key).and_then(exactly).ok_or_else(|| misses(key, &format!("{N} finite numbers")))
}

fn misses(key: &str, what: &str) -> String {
    format!("the list ({key} ...) with {what} is missing")
}

/// Width or height of an image, pixels.
fn side(value: &Value) -> Option<u32> {
    let whole = number(Some(value)).filter(|n| n.fract() == 0.0)?;
    (1..=MAX_SIDE_PX).contains(&(whole as i64)).then_some(whole as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_yarp::Dialect;

    fn seen() -> SeenRegions {
        let region = Region {
            object: "cup".into(),
            center: [12.5, 30.25],
            bounds: [10.0, 20.0, 15.0, 40.0],
            area: 88.0,
            is_clipped: true,
            confidence: 0.75,
            pose: None,
        };
        let mut covariance = [[0.0; 6]; 6];
        covariance[2][5] = 1e-6;
        let pose = SeenPose { position: [0.1, -0.2, 0.5], rotation: [1.0, 0.0, 0.0, 0.0], covariance };
        let posed = Region { pose: Some(pose), ..region.clone() };
        let intrinsics = Intrinsics {
            size: [320, 240],
            focal: [257.34, 257.0],
            center: [160.0, 120.0],
            distortion: [0.1, 0.0, 0.0, 0.0],
        };
        SeenRegions { intrinsics, regions: vec![region, posed] }
    }

    #[test]
    fn what_was_seen_comes_back_from_both_forms_of_a_bottle() {
        let bottle = seen().bottle();
        assert_eq!(SeenRegions::parse(&bottle), Ok(seen()));
        let text = Bottle::parse(bottle.to_text(), Dialect::V3).unwrap();
        assert_eq!(SeenRegions::parse(&text), Ok(seen()), "{text}");
        let nothing = SeenRegions { regions: Vec::new(), ..seen() };
        assert_eq!(SeenRegions::parse(&nothing.bottle()), Ok(nothing));
    }

    #[test]
    fn incomplete_regions_are_refused_and_the_error_names_the_missing_part() {
        let text = String::from_utf8(seen().bottle().to_text()).unwrap();
        for (from, to, what) in [
            ("size 320 240", "size 320 0", "size"),
            ("size 320 240", "size 320 240.5", "size"),
            ("focal 257", "focal -257", "focal"),
            ("(center 160.0", "(center inf", "center"),
            ("distortion", "distort", "distortion"),
            ("(regions ", "(region ", "regions"),
            ("(cup (center", "(7 (center", "region 1"),
            ("area 88.0", "area much", "region 1: the list (area"),
            ("clipped 1", "clipped yes", "region 1: the list (clipped"),
            ("rotation 1.0", "rotation", "region 2: the list (rotation"),
        ] {
            let wrong = text.replacen(from, to, 1);
            assert_ne!(wrong, text, "{from} is not in {text}");
            let refused = SeenRegions::parse(&Bottle::parse(wrong, Dialect::V3).unwrap()).unwrap_err();
            assert!(refused.contains(what), "{from} -> {to}: {refused}");
        }
        assert!(SeenRegions::parse(&Bottle::new()).is_err());
        let many = SeenRegions { regions: vec![seen().regions[0].clone(); MAX_REGIONS + 1], ..seen() };
        assert!(SeenRegions::parse(&many.bottle()).unwrap_err().contains("more than"));
    }
}
