//! Meshes of a robot's links, each on the entity of its link, so that it moves with the shapes around it.

use crate::body::{RobotEntities, entity};
use crate::palette;
use crate::stream::{EntityStream, Written};
use crate::surface::mesh3d;
use mobee_import::LinkSurface;
use mobee_model::Robot;
use nalgebra::Translation3;
use rerun::components::AlbedoFactor;

/// Node of each link that has meshes.
///
/// # Errors
/// The name of a link that is not in the robot.
pub(super) fn nodes<'a>(robot: &Robot, links: &'a [LinkSurface]) -> Result<Vec<(usize, &'a LinkSurface)>, String> {
    let node = |l: &'a LinkSurface| Ok((robot.marker(&l.link).ok_or_else(|| l.link.clone())?.node, l));
    links.iter().filter(|l| !l.meshes.is_empty()).map(node).collect()
}

/// Writes the meshes as static data.
pub(super) fn write(stream: &EntityStream, body: &RobotEntities, links: &[(usize, &LinkSurface)]) -> Written {
    for (node, link) in links {
        let Some(seat) = body.seats.get(*node) else { continue };
        let place = Translation3::from(seat.offset) * link.turn;
        for (i, mesh) in link.meshes.iter().enumerate() {
            let path = format!("{}/mesh_{}_{i}", seat.entity, entity(&link.link));
            stream.log_static(&path, &mesh3d(mesh, &place).with_albedo_factor(AlbedoFactor(palette::MESH.into())))?;
        }
    }
    Ok(())
}
