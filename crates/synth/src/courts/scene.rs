//! One scene: a place, a court's paint and what stands on it, and the camera before it.

use image::RgbImage;
use nalgebra::Point3;
use rand::RngExt;

use super::super::broadcast::Kind;
use super::super::footage::crowd::Crowd;
use super::super::footage::develop::Developing;
use super::super::footage::easel::{Easel, Rays};
use super::super::footage::person::Held;
use super::super::footage::place::{Place, Style};
use super::super::footage::props::{self, Captions};
use super::super::random::canvas::{Canvas, PaintColour};
use super::super::random::noise::smooth;
use super::furniture::{Furniture, Someone};
use super::ground::Ground;
use super::piece::Piece;
use super::{lens, markings, viewpoint};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::random::Random;

/// White paint and the others that lines have (blue, red, yellow; in halls black), fractions of full scale, and how often it is white.
const WHITE: PaintColour = [0.93, 0.93, 0.9];
const PAINTS: [PaintColour; 4] = [[0.1, 0.2, 0.6], [0.7, 0.12, 0.12], [0.9, 0.75, 0.15], [0.08, 0.08, 0.08]];
const IS_WHITE: f64 = 0.8;
/// Colours of table tops: ITTF tables are dark blue or green, a few grey.
const TABLES: [PaintColour; 3] = [[0.08, 0.2, 0.42], [0.08, 0.28, 0.2], [0.2, 0.22, 0.25]];
/// Opacity of paint; how often it is worn, and from which level of the noise on it is gone: at the least about half of it, so that people
/// still see the court.
const OPACITY: [f32; 2] = [0.7, 1.0];
const WORN: f64 = 0.35;
const GONE: [f32; 2] = [0.48, 0.9];
/// Size of worn places in the finer picture, px, octaves and falloff of their noise, and how steep their edges are.
const WORN_SIZE: f32 = 24.0;
const WORN_OCTAVES: u32 = 3;
const WORN_FALLOFF: f32 = 0.8;
const WORN_STEEP: f32 = 6.0;
/// How often parts of a court have a colour of their own, and a hall's floor is one colour inside and outside of the court.
const COLOURED: f64 = 0.4;
const ONE_COLOUR: f64 = 0.5;
/// How often another sport's lines lie on the floor: of a hall, and outside, where only tennis courts have them.
const SHARED: f64 = 0.4;
const SHARED_OUTSIDE: f64 = 0.1;
/// Ground beyond the court's lines to the walls, m; for a table beyond its playing area.
const BEYOND: [f64; 2] = [1.2, 6.5];
/// Half the playing area around a table, m (ITTF: 7 by 14 m).
const TABLE_AREA: [f64; 2] = [3.5, 7.0];
/// Half the size of a floor that shows no court, m.
const EMPTY_ROOM: [[f64; 2]; 2] = [[4.0, 14.0], [5.0, 20.0]];
/// Blur of what is out of focus or moves, px; the others are sharp.
const BLUR: [f64; 2] = [0.3, 2.2];
const IS_BLURRED: f64 = 0.4;
/// Quality of the JPEG file: of frames of streams to photographs.
const QUALITY: std::ops::RangeInclusive<u8> = 30..=95;
/// Most people.
const PEOPLE: usize = 10;
/// How often a stadium's picture has captions.
const CAPTIONED: f64 = 0.6;
/// Brightness of printed boards.
const PRINTED: f32 = 0.9;

/// Something painted on the ground.
struct Painted {
    piece: Piece,
    colour: PaintColour,
}

/// All that a picture shows.
pub(super) struct Scenery {
    pub camera: Camera,
    pub quality: u8,
    place: Place,
    ground: Ground,
    painted: Vec<Painted>,
    /// A table's lines.
    on_table: Vec<Painted>,
    opacity: f32,
    gone: Option<f32>,
    furniture: Option<Furniture>,
    people: Vec<Someone>,
    captions: Captions,
    developing: Developing,
    blur: f64,
    seed: u64,
}

/// What is like a sport in the surroundings that it is played in.
fn kind(court: &str) -> Kind {
    match court {
        "table-tennis" => Kind::TableTennis,
        "tennis" | "pickleball" | "padel" => Kind::Tennis,
        _ => Kind::Volleyball,
    }
}

/// How often a sport is played in a hall; half of the others are in a stadium.
fn in_hall(court: &str) -> f64 {
    match court {
        "tennis" => 0.25,
        "pickleball" | "padel" => 0.4,
        _ => 0.75,
    }
}

fn held(court: &str) -> Held {
    match court {
        "tennis" | "badminton" => Held::Racket,
        "table-tennis" | "pickleball" | "padel" => Held::Bat,
        _ => Held::Nothing,
    }
}

fn paint(is_hall: bool, random: &mut Random) -> PaintColour {
    let coloured = if is_hall { PAINTS.len() } else { PAINTS.len() - 1 };
    match random.random_bool(IS_WHITE) {
        true => WHITE,
        false => PAINTS[random.random_range(0..coloured)],
    }
}

fn style(court: &str, random: &mut Random) -> Style {
    if random.random_bool(in_hall(court)) {
        Style::Hall
    } else if random.random_bool(0.5) {
        Style::Stadium
    } else {
        Style::Park
    }
}

impl Scenery {
    /// A scene with a court, or without.
    ///
    /// # Errors
    /// As [`super::CourtPicture::draw`].
    pub fn draw(court: Option<&'static str>, random: &mut Random) -> Result<Self> {
        let sport = court.unwrap_or_else(|| markings::courts()[random.random_range(0..markings::courts().len())]);
        let style = style(sport, random);
        let is_hall = style == Style::Hall;
        let colour = if sport == "table-tennis" { WHITE } else { paint(is_hall, random) };
        let ([wide, long], height) = markings::extent(sport)?;
        let mut inner = if sport == "table-tennis" { TABLE_AREA } else { [wide, long] };
        let mut room = [0, 1].map(|axis| inner[axis] + random.random_range(BEYOND[0]..BEYOND[1]));
        if court.is_none() {
            inner = [0.0; 2];
            room = EMPTY_ROOM.map(|[least, most]| random.random_range(least..most));
        }
        let mut place = Place::around(inner, kind(sport), style, room, colour, random);
        // Shadows lie on paint as well: the ground's own are laid over it.
        place.shade = None;
        if is_hall && random.random_bool(ONE_COLOUR) {
            place.outer = place.inner;
        }
        let of_ground = if court.is_none() { Ground::jointed } else { Ground::draw };
        let ground = of_ground(is_hall, room, random);
        let (mut painted, on_table) = match court {
            Some(court) => lines(court, colour, random)?,
            None => (vec![], vec![]),
        };
        if let Some(court) = court
            && random.random_bool(if is_hall { SHARED } else { SHARED_OUTSIDE })
        {
            let others = shared(court, is_hall, room, random)?;
            painted.splice(0..0, others);
        }
        let camera = viewpoint::draw([wide, long], height, random)?;
        let table = TABLES[random.random_range(0..TABLES.len())];
        let furniture = court.map(|court| Furniture::draw(court, table, random)).transpose()?;
        let reach = if sport == "table-tennis" { [2.0 * wide, 1.6 * long] } else { [wide, long] };
        let people = random.random_range(0..=PEOPLE);
        let people = (0..people).map(|_| Someone::draw(reach, held(sport), random)).collect();
        let is_captioned = style == Style::Stadium && random.random_bool(CAPTIONED);
        Ok(Self {
            captions: if is_captioned { Captions::draw(camera.size().xy(), random) } else { Captions::default() },
            developing: Developing::draw(random),
            blur: if random.random_bool(IS_BLURRED) { random.random_range(BLUR[0]..BLUR[1]) } else { 0.0 },
            quality: random.random_range(QUALITY),
            opacity: random.random_range(OPACITY[0]..OPACITY[1]),
            gone: random.random_bool(WORN).then(|| random.random_range(GONE[0]..GONE[1])),
            seed: random.random_range(0..u64::MAX),
            camera,
            place,
            ground,
            painted,
            on_table,
            furniture,
            people,
        })
    }

    /// Makes it one without what blurs, hides and wears, and with these lines of a colour only.
    #[cfg(test)]
    pub fn make_plain(&mut self, lines: &[gravisight_geometry::camera::CourtLine], colour: PaintColour) {
        self.painted = lines.iter().filter_map(markings::piece).map(|piece| Painted { piece, colour }).collect();
        self.people.clear();
        self.furniture = None;
        (self.gone, self.blur, self.opacity) = (None, 0.0, 1.0);
        self.captions = Captions::default();
        self.developing = Developing::draw(&mut gravisight_geometry::random::Stream::Scene.of(0));
    }

    /// The picture that the camera takes.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn picture(&self, random: &mut Random) -> Result<RgbImage> {
        let taken = lens::without(&self.camera)?;
        let fine = self.seen(&taken, random)?;
        let mut canvas = lens::through(&self.camera, &fine, &taken, self.blur)?;
        self.captions.paint(&mut canvas, 0.0, [-1.0; 2]);
        Ok(self.developing.develop(canvas, 0.0, random))
    }

    /// What a camera without a lens sees.
    fn seen(&self, camera: &Camera, random: &mut Random) -> Result<Canvas> {
        let mut easel = Easel::new(self.place.picture(camera, random), camera);
        let crowd = Crowd::draw(&self.place, camera, self.seed, random);
        crowd.paint_still(&mut easel);
        let rays = Rays::of(camera);
        let eye = camera.world_from_camera(&Point3::origin());
        for board in self.place.boards.iter().filter(|board| self.place.faces(&eye, board)) {
            board.paint(&mut easel, &rays, 0.0, PRINTED);
        }
        self.ground.paint_joints(&mut easel.canvas, camera, self.place.room)?;
        let wear = smooth(&easel.canvas, WORN_SIZE, WORN_OCTAVES, WORN_FALLOFF, random);
        self.paint(&mut easel, &self.painted, &wear)?;
        self.ground.paint_light(&mut easel, self.place.room, random)?;
        props::paint(&mut easel, &self.place, None, random);
        self.paint_standing(&mut easel, &wear)?;
        Ok(easel.canvas)
    }

    fn paint(&self, easel: &mut Easel, painted: &[Painted], wear: &[f32]) -> Result<()> {
        let camera = easel.camera;
        let left = |index: usize| match self.gone {
            Some(gone) => (0.5 + WORN_STEEP * (gone - wear[index])).clamp(0.0, 1.0),
            None => 1.0,
        };
        painted.iter().try_for_each(|Painted { piece, colour }| {
            piece.paint(&mut easel.canvas, camera, |spot| (*colour, self.opacity * left(spot.index)))
        })
    }

    /// People, the net and the table, from far to near.
    fn paint_standing(&self, easel: &mut Easel, wear: &[f32]) -> Result<()> {
        let camera = easel.camera;
        let eye = camera.world_from_camera(&Point3::origin());
        let depth = |at: &Point3<f64>| camera.camera_from_world(at).z;
        let is_table = self.furniture.as_ref().is_some_and(Furniture::is_table);
        let is_beyond = |feet: &Point3<f64>| match is_table {
            true => depth(feet) > depth(&Point3::origin()),
            false => feet.y * eye.y < 0.0,
        };
        let mut people: Vec<&Someone> = self.people.iter().filter(|someone| someone.is_visible(easel)).collect();
        people.sort_by(|a, b| depth(&b.feet()).total_cmp(&depth(&a.feet())));
        let (beyond, before): (Vec<&Someone>, Vec<&Someone>) =
            people.into_iter().partition(|someone| is_beyond(&someone.feet()));
        if let Some(furniture) = &self.furniture {
            furniture.paint_behind(easel)?;
        }
        beyond.iter().for_each(|someone| someone.paint(easel));
        if let Some(furniture) = &self.furniture {
            furniture.paint_middle(easel, |easel| self.paint(easel, &self.on_table, wear))?;
        }
        before.iter().for_each(|someone| someone.paint(easel));
        Ok(())
    }
}

/// A court's paint on the ground and on its table.
fn lines(court: &str, colour: PaintColour, random: &mut Random) -> Result<(Vec<Painted>, Vec<Painted>)> {
    let singles = court == "tennis" && random.random_bool(0.2);
    let mut painted = Vec::new();
    if random.random_bool(COLOURED) {
        let of_areas: PaintColour = std::array::from_fn(|_| random.random_range(0.05..0.6));
        painted.extend(markings::areas(court).into_iter().map(|piece| Painted { piece, colour: of_areas }));
    }
    let straight = markings::lines(court, singles)?;
    let pieces = straight.iter().filter_map(markings::piece).chain(markings::curves(court));
    let lines: Vec<Painted> = pieces.map(|piece| Painted { piece, colour }).collect();
    if court == "table-tennis" {
        return Ok((painted, lines));
    }
    painted.extend(lines);
    Ok((painted, vec![]))
}

/// Another sport's lines on the same floor, along it or across; none where they do not fit.
fn shared(court: &str, is_hall: bool, room: [f64; 2], random: &mut Random) -> Result<Vec<Painted>> {
    let others: Vec<&str> =
        markings::courts().into_iter().filter(|other| *other != court && *other != "table-tennis").collect();
    let other = others[random.random_range(0..others.len())];
    let colour = paint(is_hall, random);
    let is_across = random.random_bool(0.5);
    let ([wide, long], _) = markings::extent(other)?;
    let [wide, long] = if is_across { [long, wide] } else { [wide, long] };
    let [aside, along] = [room[0] - wide, room[1] - long];
    if aside <= 0.0 || along <= 0.0 {
        return Ok(vec![]);
    }
    let by = match random.random_bool(0.5) {
        true => [0.0; 2],
        false => [random.random_range(-aside..aside), random.random_range(-along..along)],
    };
    let turn = if is_across { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    let straight = markings::lines(other, false)?;
    let pieces = straight.iter().filter_map(markings::piece).chain(markings::curves(other));
    Ok(pieces.map(|piece| Painted { piece: piece.moved(turn, by), colour }).collect())
}
