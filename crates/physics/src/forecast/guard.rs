//! Starts inside an obstacle.
//!
//! A soft wall launches whatever starts deep inside it (the paper's: from rest 5 cm below the floor
//! to 4.8 m in half a second), and predictions early in training are such starts. Rule: a start that
//! no ordinary contact explains is moved out, along the shortest way that leads out of everything,
//! to where the ball rests against the obstacle; its velocity stays. What is ordinary, the contact model says.
//!
//! The Jacobian is the move's own derivative: it passes what happens along the wall, and loses what
//! happens across it. Only near an edge, where the way out turns without bound, it is held to twice the
//! start's.

use nalgebra::{Matrix3, Vector3};

use crate::columns::{Columns, part};
use crate::contact::Contacts;
use crate::motion::Moved;
use crate::obstacle::{Obstacle, Shape, into_box, out_of_box};

/// Moves before a ball that is shut in stays where it is.
const MAX_MOVES: usize = 8;

/// The ways out of an obstacle for a ball at `r`: direction, shift along it, and the shift's derivative.
fn ways_out(obstacle: &Obstacle, r: &Vector3<f64>, target: f64) -> Vec<(Vector3<f64>, Matrix3<f64>)> {
    let along = |n: Vector3<f64>, distance: f64| ((target - distance) * n, -n * n.transpose());
    match &obstacle.shape {
        Shape::Cuboid { centre, half, turn } if obstacle.distance(r) <= 0.0 => {
            let local = into_box(r - centre, turn);
            let faces = (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]);
            let mut ways: Vec<_> = faces
                .map(|(axis, sign)| {
                    let n = out_of_box(Vector3::ith(axis, sign), turn);
                    along(n, sign * local[axis] - half[axis])
                })
                .collect();
            ways.sort_by(|(a, _), (b, _)| a.norm().total_cmp(&b.norm()));
            ways
        }
        _ => {
            let near = obstacle.nearest(r);
            let (shift, change) = along(near.normal, near.distance);
            // the normal turns by up to 1/distance: at an edge's very line without bound
            let turned = (target - near.distance).min(near.distance.max(0.0));
            vec![(shift, change + turned * near.curvature)]
        }
    }
}

/// Moves a start out of the obstacles, as the module's rule says.
pub(crate) fn moved_out<const M: usize>(
    contacts: &Contacts,
    obstacles: &[Obstacle],
    start: &Columns<M>,
) -> (Columns<M>, Option<Moved>) {
    let inside = |r: &Vector3<f64>| {
        let depths = obstacles.iter().map(|obstacle| (obstacle, contacts.depth(obstacle), obstacle.distance(r)));
        let too_deep = depths.filter(|(_, depth, distance)| *distance < depth.lowest);
        too_deep.max_by(|(_, a, x), (_, b, y)| (a.lowest - x).total_cmp(&(b.lowest - y)))
    };
    let mut y = *start;
    let mut moved: Option<Moved> = None;
    for _ in 0..MAX_MOVES {
        let r = y.position();
        let Some((obstacle, depth, distance)) = inside(&r) else { break };
        let ways = ways_out(obstacle, &r, depth.target);
        let clear = ways.iter().find(|(shift, _)| inside(&(r + shift)).is_none());
        let Some((shift, change)) = clear.or(ways.first()) else { break };
        for (index, values) in y.0.iter_mut().enumerate() {
            let by = if index == 0 { *shift } else { change * part(values, 0) };
            values[0] += by.x;
            values[1] += by.y;
            values[2] += by.z;
        }
        let depth = depth.touching - distance;
        let first = moved.unwrap_or(Moved { surface: obstacle.surface, depth, by: Vector3::zeros(), clear: false });
        moved = Some(Moved { by: first.by + shift, ..first });
    }
    let clear = inside(&y.position()).is_none();
    (y, moved.map(|moved| Moved { clear, ..moved }))
}
