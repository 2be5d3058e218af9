//! What a URDF says about links, joints and collision shapes, with the place of each. All else in the file is passed over:
//! transmissions, sensors, materials, visual shapes and the tags of vendors can't stop a conversion.

use crate::error::{FileError, Source};
use crate::xml::{self, XmlElement};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::ops::Range;

/// More links are refused.
pub(super) const MAX_LINKS: usize = 1000;
/// Larger positions and angles are refused: their squares still fit.
const MAX_NUMBER: f64 = 1e6;
/// How a xacro file becomes a URDF.
const EXPAND: &str =
    "expand it first: `xacro FILE > robot.urdf`, or with ROS 2 `ros2 run xacro xacro FILE > robot.urdf`";

/// A URDF, as far as it matters here.
#[derive(Debug)]
pub(super) struct Document {
    /// The robot's name, or `robot`.
    pub name: String,
    /// Where the outermost tag stands.
    pub at: Range<usize>,
    /// The links in file order; no two of one name.
    pub links: Vec<Link>,
    /// The joints in file order; no two of one name.
    pub joints: Vec<Joint>,
}

/// A rigid body.
#[derive(Debug)]
pub(super) struct Link {
    /// Its name, not empty.
    pub name: String,
    /// Where its start tag stands.
    pub at: Range<usize>,
    /// The shapes that collide.
    pub collisions: Vec<Collision>,
    /// Its center of mass in its frame, if it says that it has mass there.
    pub center: Option<Vector3<f64>>,
    /// Whether there is a shape to be looked at.
    pub visual: bool,
}

/// A shape that collides.
#[derive(Debug)]
pub(super) struct Collision {
    /// Where its geometry's tag stands.
    pub at: Range<usize>,
    /// `link_from_shape`.
    pub origin: Isometry3<f64>,
    /// The shape.
    pub geometry: Geometry,
}

/// A shape in its own frame, lengths in meters as the file gives them, not yet checked.
#[derive(Debug)]
pub(super) enum Geometry {
    /// Edge lengths.
    Box { size: Vector3<f64> },
    /// Along z.
    Cylinder { radius: f64, length: f64 },
    /// Along z; the length is that between the centers of its ends.
    Capsule { radius: f64, length: f64 },
    /// A ball.
    Sphere { radius: f64 },
    /// A file, and what its coordinates are multiplied by.
    Mesh { filename: String, scale: Vector3<f64> },
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JointType {
    /// Not at all.
    Fixed,
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides between limits.
    Prismatic,
    /// Slides in a plane and turns in it.
    Planar,
    /// Any motion.
    Floating,
}

/// What two links hang on each other by.
#[derive(Debug)]
pub(super) struct Joint {
    /// Its name, not empty.
    pub name: String,
    /// Where its start tag stands.
    pub at: Range<usize>,
    /// How it moves.
    pub joint_type: JointType,
    /// `parent_from_joint` at zero.
    pub origin: Isometry3<f64>,
    /// Name of the link it leaves.
    pub parent: String,
    /// Name of the link it leads to.
    pub child: String,
    /// Its axis in its own frame, finite, not normalized.
    pub axis: Vector3<f64>,
    /// Its limits as written, radians or meters.
    pub limit: Option<Limit>,
    /// The joint it follows.
    pub mimic: Option<Mimic>,
}

/// A joint's limits, radians or meters; zero where the file gives none. May be infinite or in reverse order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// The lower one.
    pub lower: f64,
    /// The upper one.
    pub upper: f64,
}

/// A joint follows another one: `multiplier * q + offset`.
#[derive(Debug)]
pub(super) struct Mimic {
    /// Name of the leader.
    pub joint: String,
    /// 1 where the file gives none. May not be finite.
    pub multiplier: f64,
    /// 0 where the file gives none. May not be finite.
    pub offset: f64,
}

/// Reads a URDF's links and joints.
///
/// # Errors
/// If the text is no XML or another format, if a link or joint has no name or that of another, or if a number, a link's shape or a
/// joint's type can't be understood.
pub(super) fn read(source: &Source) -> Result<Document, FileError> {
    let root = xml::parse(source)?;
    if root.name != "robot" {
        return Err(other_format(source, &root));
    }
    let reading = Reading { source };
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
    Ok(Document { name, at: root.at, links, joints })
}

/// For a macro file that was expanded.
const EXPAND_USER: &str = "expand the file that uses those macros: `xacro FILE > robot.urdf`, or with ROS 2 \
                           `ros2 run xacro xacro FILE > robot.urdf`";

/// A file of another kind, by its outermost element.
fn other_format(source: &Source, root: &XmlElement) -> FileError {
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

/// What reading an element needs.
struct Reading<'a> {
    /// The file, for errors.
    source: &'a Source,
}

impl Reading<'_> {
    /// All children of the root of a kind, each with a name of its own.
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

    /// Refuses macros and formulas that xacro would have replaced.
    fn refuse_xacro(&self, element: &XmlElement) -> Result<(), FileError> {
        if element.name.starts_with("xacro:") {
            return Err(self.error(element, format!("<{}>: this is a xacro file", element.name), EXPAND));
        }
        if let Some(formula) = element.values().find(|v| v.contains("${") || v.contains("$(")) {
            return Err(self.error(element, format!("`{formula}`: this is a xacro file"), EXPAND));
        }
        element.children.iter().try_for_each(|c| self.refuse_xacro(c))
    }

    fn link(&self, element: &XmlElement, name: &str) -> Result<Link, FileError> {
        let collisions = element.all("collision").map(|c| self.collision(c, name)).collect::<Result<_, _>>()?;
        let visual = element.child("visual").is_some();
        Ok(Link { name: name.to_owned(), at: element.at.clone(), collisions, center: self.center(element), visual })
    }

    /// A link's center of mass. It only helps to understand the rest, so what can't be read is none.
    fn center(&self, link: &XmlElement) -> Option<Vector3<f64>> {
        let inertial = link.child("inertial")?;
        let mass = self.number(inertial.child("mass")?, "value").ok()??;
        let center = self.vector(inertial.child("origin")?, "xyz").ok()??;
        (mass > 0.0).then_some(center)
    }

    fn collision(&self, element: &XmlElement, link: &str) -> Result<Collision, FileError> {
        let Some(shape) = element.child("geometry").and_then(|g| g.children.first()) else {
            let message = format!("link `{link}`: a collision without a geometry");
            let help = "put <geometry> with a box, cylinder, sphere or mesh into it, or remove it";
            return Err(self.error(element, message, help));
        };
        let number = |name: &str| self.number(shape, name).and_then(|v| v.ok_or_else(|| self.missing(shape, name)));
        let geometry = match shape.name.as_str() {
            "box" => Geometry::Box { size: self.vector(shape, "size")?.ok_or_else(|| self.missing(shape, "size"))? },
            "cylinder" => Geometry::Cylinder { radius: number("radius")?, length: number("length")? },
            "capsule" => Geometry::Capsule { radius: number("radius")?, length: number("length")? },
            "sphere" => Geometry::Sphere { radius: number("radius")? },
            "mesh" => Geometry::Mesh {
                filename: self.required(shape, "filename")?.to_owned(),
                scale: self.vector(shape, "scale")?.unwrap_or(Vector3::repeat(1.0)),
            },
            other => {
                let message = format!("link `{link}`: a collision geometry of the unknown kind <{other}>");
                return Err(self.error(shape, message, "use a box, cylinder, capsule, sphere or mesh"));
            }
        };
        Ok(Collision { at: shape.at.clone(), origin: self.origin(element)?, geometry })
    }

    fn joint(&self, element: &XmlElement, name: &str) -> Result<Joint, FileError> {
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
            let end = element.child(kind).ok_or_else(|| {
                let message = format!("joint `{name}` has no {kind}");
                self.error(element, message, format!("add <{kind} link=\"...\"/>"))
            })?;
            self.required(end, "link").map(str::to_owned)
        };
        let axis = match element.child("axis") {
            Some(axis) => self.vector(axis, "xyz")?,
            None => None,
        };
        let zero = |limit, name: &str| self.number(limit, name).map(|v| v.unwrap_or(0.0));
        let limit = element.child("limit").map(|l| Ok(Limit { lower: zero(l, "lower")?, upper: zero(l, "upper")? }));
        let mimic = element.child("mimic").map(|m| {
            let joint = self.required(m, "joint")?.to_owned();
            let multiplier = self.number(m, "multiplier")?.unwrap_or(1.0);
            Ok(Mimic { joint, multiplier, offset: zero(m, "offset")? })
        });
        Ok(Joint {
            name: name.to_owned(),
            at: element.at.clone(),
            joint_type,
            origin: self.origin(element)?,
            parent: end("parent")?,
            child: end("child")?,
            axis: axis.unwrap_or(Vector3::x()),
            limit: limit.transpose()?,
            mimic: mimic.transpose()?,
        })
    }

    /// `parent_from_here`: a translation, then fixed axes roll, pitch, yaw.
    fn origin(&self, element: &XmlElement) -> Result<Isometry3<f64>, FileError> {
        let Some(origin) = element.child("origin") else { return Ok(Isometry3::identity()) };
        let bounded = |name: &str| {
            let v = self.vector(origin, name)?.unwrap_or_default();
            if v.iter().all(|c| c.abs() < MAX_NUMBER) {
                return Ok(v);
            }
            let message = format!("the origin's `{name}` is not finite or beyond {MAX_NUMBER}");
            Err(self.error(origin, message, "write meters and radians"))
        };
        let (xyz, rpy) = (bounded("xyz")?, bounded("rpy")?);
        let turn = UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z);
        Ok(Isometry3::from_parts(Translation3::from(xyz), turn))
    }

    /// A number; none if the attribute is missing.
    fn number(&self, element: &XmlElement, name: &str) -> Result<Option<f64>, FileError> {
        let Some(text) = element.get(name) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| {
            self.error(element, format!("`{name}` is `{text}`, which is not a number"), "write a number such as 0.25")
        })
    }

    /// Three finite numbers, with spaces or, as some write, commas between; none if the attribute is missing.
    fn vector(&self, element: &XmlElement, name: &str) -> Result<Option<Vector3<f64>>, FileError> {
        let Some(text) = element.get(name) else { return Ok(None) };
        let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) if [x, y, z].iter().all(|c| c.is_finite()) => Ok(Some(Vector3::new(x, y, z))),
            _ => {
                let message = format!("`{name}` is `{text}`, which is not three finite numbers");
                Err(self.error(element, message, "write three numbers with spaces between, such as 0 0 0.25"))
            }
        }
    }

    /// An attribute that must be there and not be empty.
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
