//! Pictures of random scenes with a ball of any look anywhere: what a network that reads apparent size learns from.
//!
//! A crop is drawn from its seed alone. Where a ball's picture is, and how large, is known exactly; nothing else is real.

mod background;
pub(super) mod ball;
pub(super) mod canvas;
pub(super) mod noise;
mod real;
mod sensor;
mod squeeze;
#[cfg(test)]
mod tests;

use image::{Rgb, RgbImage};
use rand::RngExt;

pub use self::background::Spot;
use self::ball::{Layer, Look};
use self::canvas::{Canvas, Ellipse, PaintColour, Polygon, mix};
use self::noise::Normals;
pub(super) use self::real::CutOut;
pub use self::real::{LabelledBall, LabelledPhotograph};
use self::squeeze::Squeeze;
use gravisight_geometry::random::{Random, Stream};
use gravisight_geometry::size::Size;

/// Smallest radius drawn, px.
pub const SMALLEST: f64 = 1.5;
/// Largest radius drawn, px; in small pictures at most a third of the shorter side.
pub const LARGEST: f64 = 60.0;
/// Fraction of a ball that must be seen for it to count as there.
const LEAST_VISIBLE: f32 = 0.4;
/// How often something is put before the ball.
const OCCLUDED: f64 = 0.2;
/// How often the ball casts a shadow on something near.
const SHADOWED: f64 = 0.4;
/// Least way between what two balls cover, px: their places in a heatmap stay apart.
const CLEAR: f32 = 12.0;
/// How often there is another ball, where there may be.
const ANOTHER: f64 = 0.6;
/// Least mean difference between a ball and what is behind it, fractions of full scale: nobody sees less. The second is
/// divided by the radius: of a small ball the noise hides more.
const LEAST_CONTRAST: [f32; 2] = [0.07, 0.25];
/// Looks that are tried for one that can be told from what is behind it, and places for one apart from the others.
const TRIES: usize = 6;

/// A ball in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apparent {
    /// Centre of its outline (of a streak: of its way), px.
    pub centre: [f64; 2],
    /// Semi-minor axis of its outline at rest, px.
    pub radius: f64,
    /// Whether the radius is known well. It is of what was drawn; of a labelled ball it may be only roughly.
    pub is_sized: bool,
    /// Fraction of it that is seen.
    pub visible: f64,
    /// Its way during the exposure, px.
    pub streak: f64,
    /// Focal length of the camera that sees it so, px.
    pub focal: f64,
    /// Principal point of that camera, px: it may lie outside the picture, as a crop's does.
    pub principal_point: [f64; 2],
}

/// A picture of a random scene.
#[derive(Debug, Clone)]
pub struct Drawing {
    canvas: Canvas,
    /// The balls that it shows, apart from each other.
    pub balls: Vec<Apparent>,
}

impl Drawing {
    /// Red, green, blue of each pixel as fractions of full scale, row by row.
    pub fn rgb(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        let [red, green, blue] = &self.canvas.planes;
        red.iter().zip(green).zip(blue).map(|((&red, &green), &blue)| [red, green, blue])
    }

    /// As a picture.
    pub fn picture(&self) -> RgbImage {
        let pixels: Vec<[f32; 3]> = self.rgb().collect();
        let byte = |value: f32| (255.0 * value).round() as u8;
        RgbImage::from_fn(self.canvas.width as u32, self.canvas.height as u32, |x, y| {
            Rgb(pixels[y as usize * self.canvas.width + x as usize].map(byte))
        })
    }
}

/// How much darker what is behind is at night, at least and at most.
const DARKER: [f32; 2] = [0.0, 0.15];

/// Draws random scenes.
#[derive(Debug)]
pub struct RandomScenes {
    photographs: Vec<RgbImage>,
    normals: Normals,
    /// Fraction of the pictures that show no ball.
    empty: f64,
    /// Fraction of the scenes that are dark and lit from the camera: a ball's rim fades into what is behind it.
    nights: f64,
    /// Photographs with labelled balls, and the balls cut out of them.
    labelled: Vec<LabelledPhotograph>,
    cut_outs: Vec<CutOut>,
}

/// Fraction of the pictures that are parts of labelled photographs, where there are any. This and the next are chosen, not fitted.
const LABELLED: f64 = 0.3;
/// Fraction of those parts in which other balls are put beside the labelled ones: fields and halls are behind few balls otherwise.
const MORE: f64 = 0.5;
/// Fraction of the other balls that are cut out of them.
const CUT_OUT: f64 = 0.6;

impl RandomScenes {
    /// With `photographs` behind some of the balls; a fraction of `empty` pictures shows no ball.
    pub fn new(photographs: Vec<RgbImage>, empty: f64) -> Self {
        Self {
            photographs,
            normals: Normals::new(&mut Stream::Deviates.of(0)),
            empty,
            nights: 0.0,
            labelled: vec![],
            cut_outs: vec![],
        }
    }

    /// With parts of photographs whose balls are labelled, and with those balls before other things.
    pub fn with_labelled(self, labelled: Vec<LabelledPhotograph>) -> Self {
        Self { cut_outs: CutOut::all(&labelled), labelled, ..self }
    }

    /// With a fraction of scenes that are dark and lit from the camera.
    pub fn with_nights(self, nights: f64) -> Self {
        Self { nights, ..self }
    }

    /// The picture of `size` that belongs to `seed`, with `most` balls at most.
    pub fn draw(&self, size: Size, seed: u64, most: usize) -> Drawing {
        let mut random = Stream::Scene.of(seed);
        let mut drawing = match self.labelled.len() {
            count if count > 0 && random.random_bool(LABELLED) => {
                self.part(size, &self.labelled[random.random_range(0..count)], most, &mut random)
            }
            _ => self.scene(size, most, self.night(seed), &mut random),
        };
        sensor::expose(&mut drawing.canvas, &self.normals, &mut random);
        drawing
    }

    /// The picture of `size` that belongs to `seed` about a place in a photograph, with `most` balls at most; where the place lies in it:
    /// its middle and its radius, px.
    pub fn draw_about(&self, size: Size, seed: u64, most: usize, spot: &Spot) -> (Drawing, [f32; 2], f32) {
        let mut random = Stream::Scene.of(seed);
        let (canvas, centre, radius) = background::draw_about(size, &self.photographs, spot, &mut random);
        let mut drawing = self.with_some_balls(canvas, most, false, &mut random);
        sensor::expose(&mut drawing.canvas, &self.normals, &mut random);
        (drawing, centre, radius)
    }

    /// A photograph as a camera may have it that belongs to `seed`, with `most` balls at most.
    pub fn draw_before(&self, photograph: &RgbImage, seed: u64, most: usize) -> Drawing {
        let mut random = Stream::Scene.of(seed);
        let mut canvas = Canvas::new(Size::new(photograph.width(), photograph.height()), [0.0; 3]);
        background::lay(&mut canvas, photograph, [0.0; 2], 1.0, [false; 2]);
        let mut drawing = self.with_some_balls(canvas, most, false, &mut random);
        sensor::expose(&mut drawing.canvas, &self.normals, &mut random);
        drawing
    }

    /// The photographs behind some of the balls.
    pub fn photographs(&self) -> &[RgbImage] {
        &self.photographs
    }

    /// How much darker what is behind is in the scene of `seed`; none by day.
    pub fn night(&self, seed: u64) -> Option<f32> {
        let mut random = Stream::Night.of(seed);
        random.random_bool(self.nights).then(|| random.random_range(DARKER[0]..DARKER[1]))
    }

    /// A part of a labelled photograph, some squeezed, and perhaps with other balls before it.
    fn part(&self, size: Size, photograph: &LabelledPhotograph, most: usize, random: &mut Random) -> Drawing {
        let squeeze = Squeeze::random(random);
        let before = squeeze.map_or(size, |squeeze| squeeze.before(size));
        let (canvas, balls) = real::part(before, photograph, random);
        let more = if random.random_bool(MORE) { most.saturating_sub(balls.len()) } else { 0 };
        let drawing = self.with_balls(canvas, balls, more, false, random);
        match squeeze {
            Some(squeeze) => Drawing {
                canvas: squeeze.canvas(&drawing.canvas, size),
                balls: drawing.balls.into_iter().map(|ball| squeeze.ball(ball)).collect(),
            },
            None => drawing,
        }
    }

    /// The scene before the camera changes it.
    fn scene(&self, size: Size, most: usize, night: Option<f32>, random: &mut Random) -> Drawing {
        let mut canvas = background::draw(size, &self.photographs, random);
        if let Some(fraction) = night {
            canvas.planes.iter_mut().flatten().for_each(|value| *value *= fraction);
        }
        self.with_some_balls(canvas, most, night.is_some(), random)
    }

    /// What is behind, with balls before it, or without.
    fn with_some_balls(&self, canvas: Canvas, most: usize, night: bool, random: &mut Random) -> Drawing {
        let most = if random.random_bool(self.empty) { 0 } else { most };
        self.with_balls(canvas, vec![], most, night, random)
    }

    /// What is behind, which shows `labelled` balls, with at most `most` others before it.
    fn with_balls(
        &self,
        mut canvas: Canvas,
        labelled: Vec<Apparent>,
        most: usize,
        night: bool,
        random: &mut Random,
    ) -> Drawing {
        let (mut balls, mut taken) = (vec![], labelled.iter().map(Covered::by).collect::<Vec<_>>());
        for number in 0..most {
            if number == 0 || random.random_bool(ANOTHER) {
                let Some(mut ball) = DrawnBall::random(&canvas, &taken, &self.cut_outs, night, random) else {
                    continue;
                };
                // What is before one of the drawn balls might hide a labelled one.
                ball.occluder = ball.occluder.filter(|_| labelled.is_empty());
                taken.push(Covered { centre: ball.centre, radius: ball.radius, streak: ball.streak });
                balls.push(ball);
            }
        }
        let hidden = |x: usize, y: usize, balls: &[DrawnBall]| {
            let shown = |shape: &Polygon| 1.0 - background::covered(shape, x as f32, y as f32);
            1.0 - balls
                .iter()
                .filter_map(|ball| ball.occluder.as_ref())
                .map(|(shape, ..)| shown(shape))
                .product::<f32>()
        };
        let visible = |ball: &DrawnBall| {
            let mut seen = 0.0;
            ball.layer.over(&canvas, |_, x, y, value| seen += value[3] * (1.0 - hidden(x, y, &balls)));
            seen / ball.area
        };
        // Too little of a ball to be told from anything else is neither a ball nor none.
        let fractions: Vec<f32> = balls.iter().map(visible).collect();
        let mut fractions = fractions.into_iter();
        balls.retain_mut(|ball| {
            ball.visible = fractions.next().unwrap_or(0.0);
            ball.visible >= LEAST_VISIBLE
        });
        for ball in &balls {
            if random.random_bool(SHADOWED) {
                shadow(&mut canvas, ball.centre, ball.radius, random);
            }
        }
        for ball in &balls {
            ball.layer.lay(&mut canvas);
        }
        for DrawnBall { centre, radius, occluder, .. } in &balls {
            if let Some((shape, first, second)) = occluder {
                let reach = 4.0 * radius;
                canvas.fill(shape, 1.0, 1.0, |x, _| {
                    mix(*first, *second, (0.5 + (x - centre[0]) / reach).clamp(0.0, 1.0))
                });
            }
        }
        let apparent = |ball: &DrawnBall| Apparent {
            centre: ball.centre.map(f64::from),
            radius: f64::from(ball.radius),
            is_sized: true,
            visible: f64::from(ball.visible),
            streak: f64::from(ball.streak),
            focal: ball.focal,
            principal_point: ball.principal_point,
        };
        let balls = labelled.into_iter().chain(balls.iter().map(apparent)).collect();
        Drawing { canvas, balls }
    }
}

/// What a ball covers, px.
struct Covered {
    centre: [f32; 2],
    radius: f32,
    streak: f32,
}

impl Covered {
    fn by(ball: &Apparent) -> Self {
        let &Apparent { centre, radius, streak, .. } = ball;
        Self { centre: centre.map(|at| at as f32), radius: radius as f32, streak: streak as f32 }
    }
}

/// A ball before it is drawn.
struct DrawnBall {
    centre: [f32; 2],
    radius: f32,
    streak: f32,
    layer: Layer,
    /// Its fraction of all pixels, px².
    area: f32,
    /// What is before it, and its colours.
    occluder: Option<(Polygon, PaintColour, PaintColour)>,
    /// Fraction of it that is seen.
    visible: f32,
    focal: f64,
    principal_point: [f64; 2],
}

impl DrawnBall {
    /// A ball anywhere but on `others`; none where no look of it can be told from what is behind.
    fn random(
        canvas: &Canvas,
        others: &[Covered],
        cut_outs: &[CutOut],
        night: bool,
        random: &mut Random,
    ) -> Option<Self> {
        let [width, height] = [canvas.width, canvas.height].map(|side| side as f64);
        let largest = LARGEST.min(width.min(height) / 3.0);
        let radius = random.random_range(SMALLEST.ln()..largest.ln()).exp() as f32;
        let mut anywhere = || [width, height].map(|side| random.random_range(0.0..side - 1.0) as f32);
        let apart = |[x, y]: [f32; 2], other: &Covered| {
            let reach = 1.2 * (radius + other.radius)
                + 0.5 * other.streak
                + 0.5 * (ball::STREAK * radius).min(ball::STREAK_PX)
                + CLEAR;
            (x - other.centre[0]).hypot(y - other.centre[1]) > reach
        };
        let centre = (0..TRIES).map(|_| anywhere()).find(|&centre| others.iter().all(|other| apart(centre, other)))?;
        let placed = ball::place(centre, radius, random);
        let (layer, area) = (0..TRIES).find_map(|_| {
            let cut_out = match cut_outs.len() {
                count if count > 0 && !night && random.random_bool(CUT_OUT) => {
                    Some(&cut_outs[random.random_range(0..count)]).filter(|cut_out| radius <= cut_out.largest())
                }
                _ => None,
            };
            let layer = match cut_out {
                Some(cut_out) => cut_out.layer(&placed, random),
                None => {
                    let look = Look::random(radius, random);
                    let look = if night { look.lit_from_camera(random) } else { look };
                    Layer::still(&placed, &look)
                }
            };
            let area = layer.area();
            let layer = layer.moved(placed.streak);
            (layer.contrast(canvas) >= LEAST_CONTRAST[0] + LEAST_CONTRAST[1] / radius).then_some((layer, area))
        })?;
        let occluder = random.random_bool(OCCLUDED).then(|| background::occluder(centre, radius, random));
        let [dx, dy] = placed.streak;
        let ball::Placed { focal, principal_point, .. } = placed;
        Some(Self { centre, radius, streak: dx.hypot(dy), layer, area, occluder, visible: 0.0, focal, principal_point })
    }
}

/// A ball's shadow on something flat, near it.
fn shadow(canvas: &mut Canvas, centre: [f32; 2], radius: f32, random: &mut Random) {
    let reach = radius * random.random_range(0.9..1.4_f32);
    let away = radius * random.random_range(0.3..4.0_f32);
    let (sin, cos) = random.random_range(-0.6..3.7_f32).sin_cos();
    let shape = Ellipse {
        centre: [centre[0] + away * cos, centre[1] + away * sin],
        semi: [reach, reach * random.random_range(0.2..0.8_f32)],
        axis: [1.0, 0.0],
    };
    let (softness, strength) = (random.random_range(1.0..1.0 + radius), random.random_range(0.1..0.7));
    canvas.fill(&shape, softness, strength, |_, _| [0.0; 3]);
}
