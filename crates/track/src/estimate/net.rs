//! The net: a ball goes over it, or is stopped, which is a hit.

use nalgebra::Vector3;

use gravisight_physics::Scene;

/// A section of a net between two points of its upper edge.
#[derive(Debug, Clone, Copy)]
pub struct Net {
    from: Vector3<f64>,
    to: Vector3<f64>,
    /// Horizontal unit vector across it.
    normal: Vector3<f64>,
}

/// Where a ball goes through a net.
#[derive(Debug, Clone, Copy)]
pub struct Through {
    /// How far below its upper edge, m.
    pub below: f64,
    /// How that changes with the ball's place, at its velocity there.
    pub slope: Vector3<f64>,
}

impl Net {
    /// Of a scene.
    pub fn of(scene: &Scene) -> Vec<Self> {
        let section = |pair: &[[f64; 3]]| {
            let [from, to] = [Vector3::from(pair[0]), Vector3::from(pair[1])];
            let normal = Vector3::z().cross(&(to - from)).try_normalize(1e-6)?;
            Some(Self { from, to, normal })
        };
        scene.net.windows(2).filter_map(section).collect()
    }

    /// Where a ball's centre that flies straight from one place to another goes through it; none where it does not, or above its edge.
    pub fn through(&self, before: &Vector3<f64>, after: &Vector3<f64>) -> Option<Through> {
        let [start, end] = [before, after].map(|at| self.normal.dot(&(at - self.from)));
        if start * end >= 0.0 {
            return None;
        }
        let along = start / (start - end);
        let (at, edge, displacement) = (before.lerp(after, along), self.to - self.from, after - before);
        let level = Vector3::new(edge.x, edge.y, 0.0);
        let across = level.dot(&(at - self.from)) / level.norm_squared();
        let below = self.from.z + across * edge.z - at.z;
        // A ball that is a little higher crosses as much higher; one that is nearer crosses earlier, as it flies.
        let slope = self.normal * (displacement.z / self.normal.dot(&displacement)) - Vector3::z();
        ((0.0..=1.0).contains(&across) && below > 0.0).then_some(Through { below, slope })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_below_the_edge_goes_through_and_one_above_does_not() {
        let net = Net::of(&Scene::named("tennis").unwrap());
        let hit = |z: f64| {
            let (before, after) = (Vector3::new(1.0, -0.5, z), Vector3::new(1.2, 0.5, z - 0.1));
            net.iter().find_map(|net| net.through(&before, &after))
        };
        let through = hit(0.6).unwrap();
        // The edge is at 0.914 m in the middle and at 1.07 m at the posts, 6.4 m away.
        let edge = 0.914 + (1.07 - 0.914) * 1.1 / 6.399;
        assert!((through.below - (edge - 0.55)).abs() < 1e-9);
        let step = 1e-6;
        for axis in 0..3 {
            let moved = Vector3::ith(axis, step);
            let at = |sign: f64| {
                let (before, after) = (Vector3::new(1.0, -0.5, 0.6), Vector3::new(1.2, 0.5, 0.5));
                let moved = net.iter().find_map(|net| net.through(&(before + moved * sign), &(after + moved * sign)));
                moved.unwrap().below
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            // The edge's own slope, which is small, is left out.
            assert!((slope - through.slope[axis]).abs() < 0.03, "{axis}: {slope} {}", through.slope);
        }
        assert!(hit(1.2).is_none());
        let beside = (Vector3::new(9.0, -0.5, 0.3), Vector3::new(9.0, 0.5, 0.3));
        assert!(net.iter().all(|net| net.through(&beside.0, &beside.1).is_none()));
    }
}
