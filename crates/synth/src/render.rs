//! A small ray-caster that draws the paper's scenes as MuJoCo's renderer does: OpenGL's lighting at the corners of a grid
//! on each face and interpolated in between, one shadow-casting spot light, the headlight, a floor that mirrors, four
//! samples a pixel.
//!
//! Only the ball moves. What a pixel shows without it is worked out once for a camera; a frame then looks again only at
//! pixels where the ball, its shadow or its mirror image can be.

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Point3, Vector3};

use super::scenes::{BallLook, Paper};
use super::studio::{CLEAR, Colour, FLOOR_GRID, Face, RayCaster, faces, sphere, wall};
use super::{Disturbance, Site};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::size::Size;

/// Samples of a pixel, px from its centre.
const SAMPLES: [[f64; 2]; 4] = [[-0.125, -0.375], [0.375, -0.125], [-0.375, 0.125], [0.125, 0.375]];
/// MuJoCo draws a polyhedron of 28 slices and 16 stacks inside the sphere; its outline is a little smaller.
const INSCRIBED: f64 = 0.995;
/// What a see-through face adds to what is behind it. It is drawn twice, as OpenGL's two sorted passes do.
#[derive(Clone, Copy)]
struct Veil {
    distance: f64,
    cover: f64,
    colour: Colour,
}

impl Veil {
    fn over(veil: Option<Self>, distance: f64, behind: Colour) -> Colour {
        match veil {
            Some(veil) if veil.distance < distance => veil.colour * veil.cover + behind * (1.0 - veil.cover),
            _ => behind,
        }
    }
}

/// What one sample shows without the ball.
struct SurfaceSample {
    along: Vector3<f64>,
    /// The opaque surface: how far, where; infinitely far without one.
    distance: f64,
    point: Point3<f64>,
    /// Its light without the spot, and the spot's if no box shadows it.
    dark: Colour,
    spot: Colour,
    /// What a floor mirrors: direction, distance of what is seen there, its colour.
    mirror: Option<(Vector3<f64>, f64, Colour)>,
    veil: Option<Veil>,
}

/// A pixel without the ball, and a ball around what its samples see.
struct Pixel {
    colour: Rgb<u8>,
    middle: Point3<f64>,
    reach: f64,
    mirrors: bool,
    lit: bool,
}

/// Draws one environment through one camera.
pub struct Renderer {
    studio: RayCaster<'static>,
    ball: BallLook,
    camera: Camera,
    eye: Point3<f64>,
    samples: Vec<SurfaceSample>,
    pixels: Vec<Pixel>,
}

fn byte(colour: Colour) -> Rgb<u8> {
    Rgb([0, 1, 2].map(|channel| (colour[channel].clamp(0.0, 1.0) * 255.0).round() as u8))
}

impl Renderer {
    /// For a place, as `camera` sees it, with what is disturbed.
    ///
    /// # Errors
    /// As [`RayCaster::new`](super::Studio::new).
    pub(super) fn new(
        paper: &'static Paper,
        site: Site,
        camera: &Camera,
        disturbance: Option<Disturbance>,
    ) -> Result<Self> {
        let bare = disturbance == Some(Disturbance::Background);
        let mut all = Vec::new();
        if let Some(floor) = paper.floor(site) {
            all.push(Face {
                centre: Point3::origin(),
                axes: [Vector3::x(), Vector3::y(), Vector3::z()],
                half: [f64::INFINITY; 2],
                cell: [FLOOR_GRID; 2],
                colour: Vector3::from(if bare { paper.disturbances.bare_floor } else { floor.colour }).cast(),
                alpha: 1.0,
            });
        }
        all.extend(paper.walls(site).iter().map(wall));
        if !bare {
            all.extend(paper.blocks(site)?.iter().flat_map(faces));
        }
        let eye = camera.world_from_camera(&Point3::origin());
        let studio = RayCaster {
            paper,
            lamp: paper.light(site),
            floor: paper.floor(site).is_some_and(|floor| floor.reflectance > 0.0),
            faces: all,
            anchor: paper.anchor(site),
            forward: camera.world_from_camera(&Point3::new(0.0, 0.0, 1.0)) - eye,
            light: Point3::from(paper.light(site).position),
            axis: Vector3::from(paper.light(site).direction).normalize(),
        };
        let (mut ball, camera) = (paper.ball(site).clone(), camera.clone());
        if disturbance == Some(Disturbance::Ball) {
            ball.radius *= paper.disturbances.ball_scale;
        }
        let mut renderer = Self { studio, ball, camera, eye, samples: Vec::new(), pixels: Vec::new() };
        let Size { width, height } = renderer.camera.size();
        for row in 0..height {
            for column in 0..width {
                renderer.prepare(f64::from(column), f64::from(row))?;
            }
        }
        Ok(renderer)
    }

    /// Adds a pixel.
    fn prepare(&mut self, column: f64, row: f64) -> Result<()> {
        let first = self.samples.len();
        for [x, y] in SAMPLES {
            let along = self.camera.world_from_image(&Point2::new(column + x, row + y), 1.0)? - self.eye;
            let sample = self.look(along.normalize());
            self.samples.push(sample);
        }
        let samples = &self.samples[first..];
        let colour = samples.iter().map(|sample| self.shade(sample, None)).sum::<Colour>() / SAMPLES.len() as f64;
        let middle = Point3::from(samples.iter().map(|sample| sample.point.coords).sum::<Vector3<f64>>() / 4.0);
        self.pixels.push(Pixel {
            colour: byte(colour),
            middle,
            reach: samples.iter().map(|sample| (sample.point - middle).norm()).fold(0.0, f64::max),
            mirrors: samples.iter().any(|sample| sample.mirror.is_some()),
            lit: samples.iter().any(|sample| sample.spot != Colour::zeros()),
        });
        Ok(())
    }

    /// What a ray from the eye shows without the ball.
    fn look(&self, along: Vector3<f64>) -> SurfaceSample {
        let studio = &self.studio;
        let veil = self.veil(&self.eye, &along, &self.eye, None);
        let hit = studio.cast(&self.eye, &along, |face| face.alpha >= 1.0);
        if let Some((anchor, distance)) = self.anchor(&along)
            && hit.is_none_or(|hit| distance < hit.distance)
        {
            let point = self.eye + along * distance;
            let normal = point.coords.normalize();
            let (lit, tint) = (studio.light(&point, &normal, &self.eye), Vector3::from(anchor.colour).cast());
            let shadowed = studio.shadowed(&(point + normal * CLEAR));
            let spot = if shadowed { Colour::zeros() } else { lit.spot.of(&tint) };
            return SurfaceSample { along, distance, point, dark: lit.head.of(&tint), spot, mirror: None, veil };
        }
        let Some(hit) = hit else {
            let (point, none) = (self.eye, Colour::zeros());
            return SurfaceSample { along, distance: f64::INFINITY, point, dark: none, spot: none, mirror: None, veil };
        };
        let face = &studio.faces[hit.face];
        let lit = face.lit(studio, &hit.point, &self.eye);
        let spot = if studio.shadowed(&hit.point) { Colour::zeros() } else { lit.spot.of(&face.colour) };
        let mirror = (studio.floor && hit.face == 0).then(|| self.mirrored(&hit.point, &along));
        SurfaceSample {
            along,
            distance: hit.distance,
            point: hit.point,
            dark: lit.head.of(&face.colour),
            spot,
            mirror,
            veil,
        }
    }

    /// The ball in the centre where a ray from the eye meets it, and how far that is.
    fn anchor(&self, along: &Vector3<f64>) -> Option<(&'static BallLook, f64)> {
        let anchor = self.studio.anchor?;
        sphere(&self.eye, along, &Point3::origin(), INSCRIBED * anchor.radius).map(|distance| (anchor, distance))
    }

    /// The see-through face that a ray meets; its colour is dimmed by `reflectance` in a mirror.
    fn veil(
        &self,
        from: &Point3<f64>,
        along: &Vector3<f64>,
        eye: &Point3<f64>,
        reflectance: Option<f64>,
    ) -> Option<Veil> {
        let hit = self.studio.cast(from, along, |face| face.alpha < 1.0)?;
        let face = &self.studio.faces[hit.face];
        let lit = face.lit(&self.studio, &hit.point, eye);
        let colour = face.colour * reflectance.unwrap_or(1.0);
        let cover = 1.0 - (1.0 - face.alpha) * (1.0 - face.alpha);
        Some(Veil { distance: hit.distance, cover, colour: lit.head.of(&colour) + lit.spot.of(&colour) })
    }

    /// The eye's mirror image, from which a mirror's picture is lit.
    fn mirrored_eye(&self) -> Point3<f64> {
        Point3::new(self.eye.x, self.eye.y, -self.eye.z)
    }

    /// What the floor mirrors at a point: MuJoCo dims the colours, not what shines, and leaves shadows out.
    fn mirrored(&self, point: &Point3<f64>, along: &Vector3<f64>) -> (Vector3<f64>, f64, Colour) {
        let studio = &self.studio;
        let up = Vector3::new(along.x, along.y, -along.z);
        let reflectance = studio.paper.bouncing.floor.reflectance;
        let eye = self.mirrored_eye();
        let hit = studio.cast(point, &up, |face| face.alpha >= 1.0 && face.half[0].is_finite());
        let seen = hit.map_or(Colour::zeros(), |hit| {
            let face = &studio.faces[hit.face];
            let (lit, colour) = (face.lit(studio, &hit.point, &eye), face.colour * reflectance);
            lit.head.of(&colour) + lit.spot.of(&colour)
        });
        let distance = hit.map_or(f64::INFINITY, |hit| hit.distance);
        (up, distance, Veil::over(self.veil(point, &up, &eye, Some(reflectance)), distance, seen))
    }

    /// A sample's colour, with the ball where there is one.
    fn shade(&self, sample: &SurfaceSample, ball: Option<&Point3<f64>>) -> Colour {
        let radius = INSCRIBED * self.ball.radius;
        let tint: Colour = Vector3::from(self.ball.colour).cast();
        if let Some(centre) = ball
            && let Some(distance) = sphere(&self.eye, &sample.along, centre, radius).filter(|&d| d < sample.distance)
        {
            let point = self.eye + sample.along * distance;
            let normal = (point - centre) / radius;
            let lit = self.studio.light(&point, &normal, &self.eye);
            let spot =
                if self.studio.shadowed(&(point + normal * CLEAR)) { Colour::zeros() } else { lit.spot.of(&tint) };
            return Veil::over(sample.veil, distance, lit.head.of(&tint) + spot);
        }
        let mut colour = sample.dark;
        let in_ball_shadow = ball.is_some_and(|centre| {
            let way = self.studio.light - sample.point;
            let distance = way.norm();
            sphere(&sample.point, &(way / distance), centre, radius).is_some_and(|d| d > CLEAR && d < distance)
        });
        if !in_ball_shadow {
            colour += sample.spot;
        }
        if let Some((up, distance, seen)) = &sample.mirror {
            let met = ball.and_then(|centre| Some((centre, sphere(&sample.point, up, centre, radius)?)));
            colour += match met.filter(|(_, met)| met < distance) {
                Some((centre, met)) => {
                    let point = sample.point + up * met;
                    let lit = self.studio.light(&point, &((point - centre) / radius), &self.mirrored_eye());
                    let tint = tint * self.studio.paper.bouncing.floor.reflectance;
                    lit.head.of(&tint) + lit.spot.of(&tint)
                }
                None => *seen,
            };
        }
        // Each pass is clamped before the next is added, and so is the sum.
        Veil::over(sample.veil, sample.distance, colour.map(|channel| channel.min(1.0)))
    }

    /// The picture with the ball at `centre` (world frame, m).
    pub fn frame(&self, centre: &Point3<f64>) -> RgbImage {
        let radius = self.ball.radius;
        let outline = self.outline(centre);
        let width = self.camera.size().width;
        let mirror = Point3::new(centre.x, centre.y, -centre.z);
        // The shadow's and the mirror image's axes, from the light and from the eye.
        let from_light = (centre - self.studio.light).normalize();
        let from_eye = (mirror - self.eye).normalize();
        let near = |from: &Point3<f64>, axis: &Vector3<f64>, pixel: &Pixel, at: &Point3<f64>| {
            let way = pixel.middle - from;
            let along = way.dot(axis);
            // The cone that touches the ball widens with distance.
            let wide = radius * along / ((at - from).norm_squared() - radius * radius).max(1e-9).sqrt();
            way.norm_squared() - along * along < (wide + pixel.reach).powi(2)
        };
        RgbImage::from_fn(width, self.camera.size().height, |x, y| {
            let index = (y * width + x) as usize;
            let pixel = &self.pixels[index];
            let [left, top, right, bottom] = outline;
            let inside = (left..=right).contains(&f64::from(x)) && (top..=bottom).contains(&f64::from(y));
            let touched = inside
                || pixel.lit && near(&self.studio.light, &from_light, pixel, centre)
                || pixel.mirrors && near(&self.eye, &from_eye, pixel, &mirror);
            if !touched {
                return pixel.colour;
            }
            let samples = &self.samples[SAMPLES.len() * index..SAMPLES.len() * (index + 1)];
            byte(samples.iter().map(|sample| self.shade(sample, Some(centre))).sum::<Colour>() / SAMPLES.len() as f64)
        })
    }

    /// How far what each pixel shows is with the ball at `centre`, along the camera's axis, m; infinite where nothing is. Boxes that are
    /// seen through do not count.
    ///
    /// # Errors
    /// As [`Camera::world_from_image`].
    pub fn depth(&self, centre: &Point3<f64>) -> Result<Vec<f32>> {
        let Size { width, height } = self.camera.size();
        let mut depths = Vec::with_capacity(self.camera.size().pixels());
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let at = self.camera.world_from_image(&Point2::new(f64::from(column), f64::from(row)), 1.0)? - self.eye;
            let along = at.normalize();
            let face = self.studio.cast(&self.eye, &along, |face| face.alpha >= 1.0).map(|hit| hit.distance);
            let ball = sphere(&self.eye, &along, centre, INSCRIBED * self.ball.radius);
            let anchor = self.anchor(&along).map(|(_, distance)| distance);
            let nearest = face.into_iter().chain(ball).chain(anchor).fold(f64::INFINITY, f64::min);
            depths.push((nearest / at.norm()) as f32);
        }
        Ok(depths)
    }

    /// A rectangle around the ball's picture, px: left, top, right, bottom.
    fn outline(&self, centre: &Point3<f64>) -> [f64; 4] {
        let in_camera = self.camera.camera_from_world(centre);
        let reach = (in_camera.coords.norm_squared() - self.ball.radius.powi(2)).max(1e-9).sqrt();
        let Ok(image) = self.camera.image_from_camera(&in_camera) else { return [0.0, 0.0, -1.0, -1.0] };
        let focal = self.camera.intrinsic()[(0, 0)].max(self.camera.intrinsic()[(1, 1)]);
        // Generous: an ellipse off the picture's middle is longer than the circle in it.
        let size = 1.5 * focal * self.ball.radius / reach * (in_camera.coords.norm() / in_camera.z) + 1.0;
        [image.x - size, image.y - size, image.x + size, image.y + size]
    }

    /// Fraction of 13 points of the ball's disc, as the camera sees it, that no box hides.
    pub fn visible(&self, centre: &Point3<f64>) -> f64 {
        let radius = self.ball.radius;
        let axis = |x: f64, y: f64| self.camera.world_from_camera(&Point3::new(x, y, 0.0)) - self.eye;
        let (right, down) = (axis(1.0, 0.0), axis(0.0, 1.0));
        let rings = [(0.0, 1), (0.45, 4), (0.85, 8)];
        let points =
            rings.into_iter().flat_map(|(fraction, count)| (0..count).map(move |index| (fraction, index, count)));
        let seen = points.filter(|&(fraction, index, count)| {
            let angle = std::f64::consts::TAU * f64::from(index) / f64::from(count);
            let point = centre + (right * angle.cos() + down * angle.sin()) * fraction * radius;
            let distance = (point - self.eye).norm();
            let along = (point - self.eye) / distance;
            let face = self.studio.cast(&self.eye, &along, |_| true).map(|hit| hit.distance);
            let anchor = self.anchor(&along).map(|(_, distance)| distance);
            face.into_iter().chain(anchor).all(|nearer| nearer > distance)
        });
        seen.count() as f64 / 13.0
    }
}
