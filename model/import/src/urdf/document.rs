//! Reader of a URDF's links, joints and collision shapes, with their locations. All other parts of the file are listed
//! as unused: transmissions, sensors, materials, visual shapes and vendors' tags can't stop a conversion.

pub(super) use super::contents::{
    Document, JointType, Limit, Mimic, Safety, UrdfCollision, UrdfGeometry, UrdfJoint, UrdfLink,
};
use super::grouped::Grouped;
use super::sizes::DOUBTED_LENGTH_M;
use super::words::{self, Unused};
use mobee_text::xml::{self, XmlElement};
use mobee_text::{FileError, SourceText};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Maximum number of links.
pub(super) const MAX_LINKS: usize = 1000;
/// Upper bound of positions and angles, meters or radians: their squares are still representable.
const MAX_NUMBER: f64 = 1e6;
/// Minimum norm of a quaternion; a shorter one has no direction.
const MIN_QUATERNION: f64 = 1e-6;
/// Known versions of the format.
const VERSIONS: &[&str] = &["1.0", "1.1", "1.2"];
/// Remedy for a xacro file.
const EXPAND: &str =
    "expand it first: `xacro FILE > robot.urdf`, or with ROS 2 `ros2 run xacro xacro FILE > robot.urdf`";

/// Reads a URDF's links and joints. With `visual`, a link without a collision shape uses its visual shapes for
/// collision.
///
/// # Errors
/// If the text is not XML or is in another format, if a link or joint has no name or a duplicate one, or if a number, a
/// link's shape or a joint's type is invalid.
pub(super) fn read(source: &SourceText, visual: bool) -> Result<Document, FileError> {
    let root = xml::parse(source)?;
    if root.name != "robot" {
        return Err(other_format(source, &root));
    }
    let reading = UrdfReader { source, visual, far: RefCell::default(), turned: RefCell::default() };
    root.children.iter().filter(|c| c.name.starts_with("xacro:")).try_for_each(|c| reading.refuse_xacro(c))?;
    let links = reading.named(&root, "link", |e, name| reading.link(e, name))?;
    let joints = reading.named(&root, "joint", |e, name| reading.joint(e, name))?;
    if links.is_empty() {
        let (message, help) = match root.get("xmlns:xacro").is_some() {
            true => ("there is no link: this is what xacro makes of a file that only defines macros", EXPAND_USER),
            false => ("there is no link", "describe each rigid body of the robot by a <link>"),
        };
        return Err(source.error(root.at, message, help));
    }
    let name = root.get("name").filter(|n| !n.is_empty()).unwrap_or("robot").to_owned();
    let unused = Unused::of(&root, words::URDF, |link| visual && link.child("collision").is_none());
    let mut warnings = Vec::new();
    if let Some(version) = root.get("version").filter(|v| !VERSIONS.contains(v)) {
        let message =
            format!("version \"{version}\" of the format is not known; it is read as {}", VERSIONS.join(" or "));
        warnings.push(source.warning(root.at.clone(), message, "write the version that the file is made for"));
    }
    let help = "write meters";
    reading.far.into_inner().warn(source, "origins farther than 10 m, perhaps in millimeters", help, &mut warnings);
    let help = "write roll, pitch and yaw in radians: 90 degrees are 1.5708";
    let message = "origins turned by more than a full turn, perhaps in degrees";
    reading.turned.into_inner().warn(source, message, help, &mut warnings);
    Ok(Document { name, at: root.at, links, joints, unused, warnings })
}

/// Remedy for an expanded file that only defines macros.
const EXPAND_USER: &str = "expand the file that uses those macros: `xacro FILE > robot.urdf`, or with ROS 2 \
                           `ros2 run xacro xacro FILE > robot.urdf`";

/// Error for a file in another format, recognized by its root element.
fn other_format(source: &SourceText, root: &XmlElement) -> FileError {
    let help = match root.name.to_ascii_lowercase().as_str() {
        "zeropositionkinematictree" => "this is a ZRP file already; it needs no conversion",
        "sdf" | "gazebo" => "this is SDF, the format of Gazebo; give the URDF that it was made from",
        "mujoco" => "this is MJCF, the format of MuJoCo; give the URDF that it was made from",
        "collada" => "this is a mesh (COLLADA); a URDF names it in a link's <collision>",
        _ if root.name.starts_with("xacro") => EXPAND,
        _ => "a URDF begins with <robot name=\"...\">",
    };
    source.error(root.at.clone(), format!("<{}> does not begin a URDF", root.name), help)
}

/// Context of the reader.
struct UrdfReader<'a> {
    /// The file, for errors.
    source: &'a SourceText,
    /// True if visuals replace missing collisions.
    visual: bool,
    /// Origins that are suspiciously far away.
    far: RefCell<Grouped>,
    /// Origins that are rotated by more than a full turn.
    turned: RefCell<Grouped>,
}

impl UrdfReader<'_> {
    /// Reads all children of the root of a kind; their names must be unique.
    fn named<T>(
        &self,
        root: &XmlElement,
        kind: &str,
        read: impl Fn(&XmlElement, &str) -> Result<T, FileError>,
    ) -> Result<Vec<T>, FileError> {
        let mut all = Vec::new();
        let mut seen = BTreeMap::new();
        for element in root.all(kind) {
            let name = self.required(element, "name")?;
            if all.len() >= MAX_LINKS {
                let message = format!("more than {MAX_LINKS} links with their joints can't be converted");
                return Err(self.error(element, message, "split the robot, or merge fixed links"));
            }
            if seen.insert(name, ()).is_some() {
                let message = format!("there is a {kind} `{name}` already");
                return Err(self.error(element, message, "give each one a name of its own"));
            }
            self.refuse_xacro(element)?;
            all.push(read(element, name)?);
        }
        Ok(all)
    }

    /// Rejects macros and formulas that xacro would have expanded.
    fn refuse_xacro(&self, element: &XmlElement) -> Result<(), FileError> {
        if element.name.starts_with("xacro:") {
            return Err(self.error(element, format!("<{}>: this is a xacro file", element.name), EXPAND));
        }
        if let Some(formula) = element.values().find(|v| v.contains("${") || v.contains("$(")) {
            return Err(self.error(element, format!("`{formula}`: this is a xacro file"), EXPAND));
        }
        element.children.iter().try_for_each(|c| self.refuse_xacro(c))
    }

    fn link(&self, element: &XmlElement, name: &str) -> Result<UrdfLink, FileError> {
        let bare = element.child("collision").is_none() && element.child("visual").is_some();
        let kind = if bare && self.visual { "visual" } else { "collision" };
        let collisions = element.all(kind).map(|c| self.collision(c, name)).collect::<Result<_, _>>()?;
        let name = name.to_owned();
        let at = element.at.clone();
        let center = self.center(element)?;
        Ok(UrdfLink { name, at, collisions, center, bare })
    }

    /// A link's center of mass. It is only a hint for the conversion, so an unreadable one is `None`.
    fn center(&self, link: &XmlElement) -> Result<Option<Vector3<f64>>, FileError> {
        let Some(inertial) = link.child("inertial") else { return Ok(None) };
        let Some(origin) = inertial.child("origin") else { return Ok(None) };
        self.quaternion(origin)?;
        let mass = inertial.child("mass").and_then(|m| self.number(m, "value").ok().flatten());
        let center = self.vector(origin, "xyz").ok().flatten();
        Ok(center.filter(|_| mass.is_some_and(|m| m > 0.0)))
    }

    fn collision(&self, element: &XmlElement, link: &str) -> Result<UrdfCollision, FileError> {
        let shapes = self.one(element, "geometry")?.map(|g| g.children.as_slice()).unwrap_or_default();
        let Some(shape) = shapes.first() else {
            let message = format!("link `{link}`: a {} without a geometry", element.name);
            let help = "put <geometry> with a box, cylinder, sphere or mesh into it, or remove it";
            return Err(self.error(element, message, help));
        };
        if let Some(second) = shapes.get(1) {
            let message = format!("link `{link}`: a second shape in one <geometry>");
            return Err(self.error(second, message, "give each shape a <collision> of its own"));
        }
        let number = |name: &str| self.number(shape, name).and_then(|v| v.ok_or_else(|| self.missing(shape, name)));
        let geometry = match shape.name.as_str() {
            "box" => {
                UrdfGeometry::Box { size: self.vector(shape, "size")?.ok_or_else(|| self.missing(shape, "size"))? }
            }
            "cylinder" => UrdfGeometry::Cylinder { radius: number("radius")?, length: number("length")? },
            "capsule" => UrdfGeometry::Capsule { radius: number("radius")?, length: number("length")? },
            "sphere" => UrdfGeometry::Sphere { radius: number("radius")? },
            "mesh" => UrdfGeometry::Mesh {
                filename: self.required(shape, "filename")?.to_owned(),
                scale: self.scale(shape, link)?,
            },
            other => {
                let message = format!("link `{link}`: a {} geometry of the unknown kind <{other}>", element.name);
                return Err(self.error(shape, message, "use a box, cylinder, capsule, sphere or mesh"));
            }
        };
        Ok(UrdfCollision { at: shape.at.clone(), origin: self.origin(element, &format!("link `{link}`"))?, geometry })
    }

    /// The scale of a mesh. A negative factor mirrors it.
    fn scale(&self, mesh: &XmlElement, link: &str) -> Result<Vector3<f64>, FileError> {
        let scale = self.vector(mesh, "scale")?.unwrap_or(Vector3::repeat(1.0));
        if scale.iter().all(|s| *s != 0.0) {
            return Ok(scale);
        }
        let message = format!("link `{link}`: a mesh of scale {} {} {} vanishes", scale.x, scale.y, scale.z);
        Err(self.error(mesh, message, "write factors that are not 0, or leave `scale` out"))
    }

    fn joint(&self, element: &XmlElement, name: &str) -> Result<UrdfJoint, FileError> {
        let joint_type = match self.required(element, "type")? {
            "fixed" => JointType::Fixed,
            "revolute" => JointType::Revolute,
            "continuous" => JointType::Continuous,
            "prismatic" => JointType::Prismatic,
            "planar" => JointType::Planar,
            "floating" => JointType::Floating,
            other => {
                let message = format!("joint `{name}` has the unknown type `{other}`");
                return Err(self.error(element, message, "make it revolute, continuous, prismatic or fixed"));
            }
        };
        let end = |kind: &str| {
            let end = self.one(element, kind)?.ok_or_else(|| {
                let message = format!("joint `{name}` has no {kind}");
                self.error(element, message, format!("add <{kind} link=\"...\"/>"))
            })?;
            self.required(end, "link").map(str::to_owned)
        };
        let axis = self.one(element, "axis")?.map(|axis| self.vector(axis, "xyz")).transpose()?.flatten();
        let limit = self.one(element, "limit")?.map(|l| {
            let [lower, upper, velocity] = ["lower", "upper", "velocity"].map(|name| self.number(l, name));
            Ok(Limit { lower: lower?, upper: upper?, velocity: velocity? })
        });
        let safety = self.one(element, "safety_controller")?.map(|s| {
            let [lower, upper] = ["soft_lower_limit", "soft_upper_limit"].map(|name| self.number(s, name));
            Ok(Safety { at: s.at.clone(), lower: lower?, upper: upper? })
        });
        let mimic = self.one(element, "mimic")?.map(|m| {
            let joint = self.required(m, "joint")?.to_owned();
            let multiplier = self.number(m, "multiplier")?.unwrap_or(1.0);
            Ok(Mimic { joint, multiplier, offset: self.number(m, "offset")?.unwrap_or(0.0) })
        });
        Ok(UrdfJoint {
            name: name.to_owned(),
            at: element.at.clone(),
            joint_type,
            origin: self.origin(element, &format!("joint `{name}`"))?,
            parent: end("parent")?,
            child: end("child")?,
            axis: axis.unwrap_or(Vector3::x()),
            limit: limit.transpose()?,
            safety: safety.transpose()?,
            mimic: mimic.transpose()?,
        })
    }

    /// The child of a kind that may occur only once; a second one is an error, since it would be ignored.
    fn one<'e>(&self, element: &'e XmlElement, kind: &'e str) -> Result<Option<&'e XmlElement>, FileError> {
        let mut all = element.all(kind);
        let first = all.next();
        match all.next() {
            None => Ok(first),
            Some(second) => {
                let message = format!("a second <{kind}> in one <{}>", element.name);
                Err(self.error(second, message, "leave one of them"))
            }
        }
    }

    /// `parent_from_here`: a translation, then fixed-axis roll, pitch and yaw, or a quaternion. `owner` is for
    /// messages.
    fn origin(&self, element: &XmlElement, owner: &str) -> Result<Isometry3<f64>, FileError> {
        let Some(origin) = self.one(element, "origin")? else { return Ok(Isometry3::identity()) };
        let bounded = |name: &str| {
            let v = self.vector(origin, name)?.unwrap_or_default();
            if v.iter().all(|c| c.abs() < MAX_NUMBER) {
                return Ok(v);
            }
            let message = format!("the origin's `{name}` is not finite or beyond {MAX_NUMBER}");
            Err(self.error(origin, message, "write meters and radians"))
        };
        let xyz = bounded("xyz")?;
        let rpy = bounded("rpy")?;
        if xyz.amax() > DOUBTED_LENGTH_M {
            self.far.borrow_mut().add(&origin.at, format!("{owner} ({} {} {})", xyz.x, xyz.y, xyz.z));
        }
        if rpy.amax() > TAU + 0.01 {
            self.turned.borrow_mut().add(&origin.at, format!("{owner} ({} {} {})", rpy.x, rpy.y, rpy.z));
        }
        let turn = self.quaternion(origin)?.unwrap_or_else(|| UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z));
        Ok(Isometry3::from_parts(Translation3::from(xyz), turn))
    }

    /// The quaternion of an origin (URDF 1.1), of any norm; `None` if the attribute is missing.
    fn quaternion(&self, origin: &XmlElement) -> Result<Option<UnitQuaternion<f64>>, FileError> {
        let Some([x, y, z, w]) = self.numbers::<4>(origin, "quat_xyzw", "four")? else { return Ok(None) };
        if origin.get("rpy").is_some() {
            let message = "an origin with both `rpy` and `quat_xyzw`";
            return Err(self.error(origin, message, "leave one of them"));
        }
        let bounded = [x, y, z, w].iter().all(|c| c.abs() < MAX_NUMBER);
        let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), MIN_QUATERNION).filter(|_| bounded);
        turn.map(Some).ok_or_else(|| {
            let message = format!("the origin's `quat_xyzw` is {x} {y} {z} {w}, which is no rotation");
            self.error(origin, message, "write a quaternion of length 1, its real part last: 0 0 0 1")
        })
    }

    /// A number; `None` if the attribute is missing.
    fn number(&self, element: &XmlElement, name: &str) -> Result<Option<f64>, FileError> {
        let Some(text) = element.get(name) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| {
            self.error(element, format!("`{name}` is `{text}`, which is not a number"), "write a number such as 0.25")
        })
    }

    /// Three finite numbers; `None` if the attribute is missing.
    fn vector(&self, element: &XmlElement, name: &str) -> Result<Option<Vector3<f64>>, FileError> {
        Ok(self.numbers::<3>(element, name, "three")?.map(Vector3::from))
    }

    /// Finite numbers, separated by spaces or, as in some files, commas; `None` if the attribute is missing.
    fn numbers<const N: usize>(
        &self,
        element: &XmlElement,
        name: &str,
        count: &str,
    ) -> Result<Option<[f64; N]>, FileError> {
        let Some(text) = element.get(name) else { return Ok(None) };
        let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|n| <[f64; N]>::try_from(n).ok());
        numbers.filter(|n| n.iter().all(|c| c.is_finite())).map(Some).ok_or_else(|| {
            let message = format!("`{name}` is `{text}`, which is not {count} finite numbers");
            let help = format!("write {count} numbers with spaces between, such as 0 0 0.25");
            self.error(element, message, help)
        })
    }

    /// An attribute that must exist and not be empty.
    fn required<'e>(&self, element: &'e XmlElement, name: &str) -> Result<&'e str, FileError> {
        element.get(name).filter(|v| !v.is_empty()).ok_or_else(|| self.missing(element, name))
    }

    fn missing(&self, element: &XmlElement, name: &str) -> FileError {
        self.error(
            element,
            format!("<{}> without `{name}`", element.name),
            format!("write {name}=\"...\" into its tag"),
        )
    }

    fn error(&self, element: &XmlElement, message: impl Into<String>, help: impl Into<String>) -> FileError {
        self.source.error(element.at.clone(), message, help)
    }
}
