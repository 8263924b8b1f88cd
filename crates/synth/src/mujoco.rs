//! The paper's engine: MuJoCo simulates, and draws with OpenGL, without a screen (EGL).

use std::error::Error as _;
use std::f64::consts::PI;
use std::sync::Mutex;

use image::RgbImage;
use mujoco_rs::prelude::{MjData, MjModel, MjvCamera, RendererError};
use mujoco_rs::renderer::MjRenderer;
use nalgebra::Point3;

use super::scenes::Paper;
use super::studio::FLOOR;
use super::{Engine, Site, Studio};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;
use gravisight_physics::{Contact, State};

/// Steps of the simulation in a frame.
const SUBSTEPS: f64 = 34.0;
/// Samples of a pixel.
const SAMPLES: u32 = 4;
/// Side of the shadow map, texels.
const SHADOW: u32 = 1024;
/// OpenGL's exponent for a shininess of 1.
const SHINIEST: f64 = 128.0;

/// Stiffness of the room's contacts per unit mass, 1/s²: a contact of a hundredth of a second.
const ROOM_STIFFNESS: f64 = 1e5;
/// The room's size, m.
const ROOM: f64 = 2.0;
/// Fraction of the depth of OpenGL's far plane from which on a pixel shows nothing.
const NOTHING: f32 = 0.99;

/// OpenGL's functions are looked up when a context is made, for all threads.
static OPENING: Mutex<()> = Mutex::new(());

/// MuJoCo, with the scene of one shot. It belongs to the thread that made it, as its OpenGL context does.
pub struct Mujoco {
    size: Size,
    /// Depth from which on nothing is there, m.
    farthest: f32,
    data: MjData<Box<MjModel>>,
    renderer: MjRenderer,
}

impl Mujoco {
    /// For a studio's shot.
    ///
    /// # Errors
    /// [`Error::Device`] if there is no OpenGL without a screen; [`Error::Format`] if MuJoCo does not take the scene.
    pub fn new(studio: &Studio) -> Result<Self> {
        let text = model(studio.paper, studio.shot.site, &studio.camera)?;
        let model = MjModel::from_xml_string(&text).map_err(Error::format("MuJoCo's model"))?;
        let farthest = NOTHING * model.vis().map.zfar * model.stat().extent as f32;
        let _one_at_a_time = OPENING.lock();
        // The model's only camera; the picture's size is the model's, too.
        let renderer = MjRenderer::builder().camera(MjvCamera::new_fixed(0)).build(&model).map_err(failed)?;
        let renderer = renderer.with_depth_rendering(true);
        let data = MjData::try_new(Box::new(model)).map_err(Error::format("MuJoCo's model"))?;
        Ok(Self { size: studio.camera.size(), farthest, data, renderer })
    }

    /// Puts the ball somewhere, at rest and not turned.
    fn place(&mut self, centre: &Point3<f64>) {
        self.data.reset();
        self.data.qpos_mut()[..3].copy_from_slice(centre.coords.as_slice());
    }
}

impl Engine for Mujoco {
    /// At the simulation's step nearest to each time.
    fn path(&mut self, start: &State, times: &[f64]) -> Option<Vec<Point3<f64>>> {
        self.place(&start.position);
        self.data.qvel_mut()[..3].copy_from_slice(start.velocity.as_slice());
        let (step, mut steps) = (self.data.model().opt().timestep, 0.0);
        let positions = times.iter().map(|time| {
            while steps < (time / step).round() {
                self.data.step();
                steps += 1.0;
            }
            Point3::from_slice(&self.data.qpos()[..3])
        });
        Some(positions.collect())
    }

    fn picture(&mut self, centre: &Point3<f64>) -> Result<RgbImage> {
        self.place(centre);
        self.data.forward();
        self.renderer.sync_data(&mut self.data).map_err(failed)?;
        self.renderer.render().map_err(failed)?;
        let Size { width, height } = self.size;
        let pixels = self.renderer.rgb_flat().ok_or(RendererError::RgbDisabled).map_err(failed)?;
        RgbImage::from_raw(width, height, pixels.to_vec()).ok_or(RendererError::DimensionMismatch).map_err(failed)
    }

    fn depth(&mut self, centre: &Point3<f64>) -> Result<Vec<f32>> {
        self.picture(centre)?;
        let depths = self.renderer.depth_flat().ok_or(RendererError::DepthDisabled).map_err(failed)?;
        Ok(depths.iter().map(|&depth| if depth < self.farthest { depth } else { f32::INFINITY }).collect())
    }
}

fn failed(error: RendererError) -> Error {
    let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
    let reason =
        format!("{cause}; MuJoCo needs OpenGL without a screen (EGL); scripts/mujoco installs the one from Mesa");
    Error::Device { device: "opengl".into(), reason }
}

/// The scene as MuJoCo reads it.
fn model(paper: &Paper, site: Site, camera: &Camera) -> Result<String> {
    let (ball, light, head, material) = (paper.ball(site), paper.light(site), &paper.headlight, &paper.material);
    let (scene, [_, height]) = (paper.scene(site)?, camera.size().xy());
    let [integrator, joint, contact] = match site {
        Site::Environment(_) => ["Euler".into(), String::new(), format!(r#"solref="-{} 0""#, paper.bouncing.stiffness)],
        // A free joint's spring pulls towards where the model has the body, the origin. MuJoCo's usual semi-implicit
        // steps would be millimetres off; Runge and Kutta's follow the law. The ball in the centre is not touched.
        Site::Spring => {
            let [joint, contact] = [format!(r#"stiffness="{}""#, paper.spring.stiffness), r#"contype="0""#.into()];
            ["RK4".into(), joint, contact]
        }
        Site::Room => {
            let Contact::Bounce { restitution, friction, .. } = scene.contact else {
                unreachable!("the room's contact")
            };
            // A damped spring's restitution is exp(−πζ / √(1 − ζ²)).
            let ratio = restitution.ln().hypot(PI).recip() * -restitution.ln();
            let damping = 2.0 * ratio * ROOM_STIFFNESS.sqrt();
            let contact = format!(r#"solref="-{ROOM_STIFFNESS} -{damping}" friction="{friction} 0 0""#);
            // The geom with the higher priority says how two touch.
            ["Euler".into(), String::new(), contact + r#" priority="1""#]
        }
    };
    let fps = if site == Site::Room { paper.room.fps } else { paper.fps };
    let eye = camera.world_from_camera(&Point3::origin());
    let axis = |x, y| text((camera.world_from_camera(&Point3::new(x, y, 0.0)) - eye).as_slice());
    Ok(format!(
        r#"<mujoco>
<compiler angle="degree"/>
{statistic}
<option gravity="0 0 {down}" timestep="{step}" integrator="{integrator}"/>
<visual>
<global offwidth="{width}" offheight="{height}"/>
<quality offsamples="{SAMPLES}" shadowsize="{SHADOW}"/>
<headlight ambient="{ambient}" diffuse="{diffuse}" specular="{specular}"/>
</visual>
<asset>
<material name="dull" specular="{shine}" shininess="{shininess}"/>
<material name="mirror" specular="{shine}" shininess="{shininess}" reflectance="{reflectance}"/>
</asset>
<default><geom material="dull"/></default>
<worldbody>
<light pos="{light_position}" dir="{light_direction}" diffuse="{light_diffuse}" specular="{light_specular}"
 cutoff="{cutoff}" exponent="{exponent}"/>
<camera pos="{eye}" xyaxes="{right} {up}" fovy="{field_of_view}"/>
{things}
<body>
<joint type="free" {joint}/>
<geom type="sphere" size="{radius}" mass="{mass}" rgba="{colour} 1" {contact}/>
</body>
</worldbody>
</mujoco>"#,
        // By itself it takes the walls for the scene's size, and cuts off what is near.
        statistic = if site == Site::Room { format!(r#"<statistic extent="{ROOM}"/>"#) } else { String::new() },
        down = scene.gravity[2],
        step = 1.0 / (fps * SUBSTEPS),
        things = things(paper, site)?,
        width = camera.size().width,
        height = camera.size().height,
        ambient = text(&[head.ambient; 3]),
        diffuse = text(&[head.diffuse; 3]),
        specular = text(&[head.specular; 3]),
        shine = material.specular,
        shininess = material.shininess / SHINIEST,
        reflectance = paper.floor(site).map_or(0.0, |floor| floor.reflectance),
        light_position = text(&light.position),
        light_direction = text(&light.direction),
        light_diffuse = text(&[light.diffuse; 3]),
        light_specular = text(&[light.specular; 3]),
        cutoff = light.cutoff,
        exponent = light.exponent,
        eye = text(eye.coords.as_slice()),
        right = axis(1.0, 0.0),
        up = axis(0.0, -1.0),
        field_of_view = 2.0 * (height / 2.0 / camera.intrinsic()[(1, 1)]).atan().to_degrees(),
        radius = ball.radius,
        mass = ball.mass,
        colour = text(&ball.colour),
    ))
}

/// What stands around: what the ball can touch, and the ball in the centre.
fn things(paper: &Paper, site: Site) -> Result<String> {
    let floor = paper.floor(site).map(|floor| {
        let colour = text(&floor.colour);
        format!(r#"<geom type="plane" size="{FLOOR} {FLOOR} .1" rgba="{colour} 1" material="mirror"/>"#)
    });
    let walls = paper.walls(site).iter().map(|wall| {
        let [point, normal, colour] = [text(&wall.point), text(&wall.normal), text(&wall.colour)];
        format!(r#"<geom type="plane" pos="{point}" zaxis="{normal}" size="{FLOOR} {FLOOR} .1" rgba="{colour} 1"/>"#)
    });
    let anchor = paper.anchor(site).map(|anchor| {
        let (radius, colour) = (anchor.radius, text(&anchor.colour));
        format!(r#"<geom type="sphere" size="{radius}" rgba="{colour} 1" contype="0" conaffinity="0"/>"#)
    });
    let boxes = paper.blocks(site)?.iter().map(|block| {
        format!(
            r#"<geom type="box" pos="{}" size="{}" euler="0 0 {}" rgba="{} {}"/>"#,
            text(&block.position),
            text(&block.half_size),
            block.yaw,
            text(&block.colour),
            block.alpha
        )
    });
    Ok(floor.into_iter().chain(walls).chain(anchor).chain(boxes).collect::<Vec<_>>().join("\n"))
}

/// Numbers as MuJoCo reads them.
fn text<T: ToString>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}
