//! The paper's engine: MuJoCo simulates, and draws with OpenGL, without a screen (EGL).

use std::error::Error as _;
use std::sync::Mutex;

use image::RgbImage;
use mujoco_rs::prelude::{MjData, MjModel, MjvCamera, RendererError};
use mujoco_rs::renderer::MjRenderer;
use nalgebra::Point3;

use super::scenes::Paper;
use super::studio::FLOOR;
use super::{Engine, Studio};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::physics::State;
use crate::size::Size;

/// Steps of the simulation in a frame.
const SUBSTEPS: f64 = 34.0;
/// Samples of a pixel.
const SAMPLES: u32 = 4;
/// Side of the shadow map, texels.
const SHADOW: u32 = 1024;
/// OpenGL's exponent for a shininess of 1.
const SHINIEST: f64 = 128.0;

/// OpenGL's functions are looked up when a context is made, for all threads.
static OPENING: Mutex<()> = Mutex::new(());

/// MuJoCo, with the scene of one shot. It belongs to the thread that made it, as its OpenGL context does.
pub struct Mujoco {
    size: Size,
    data: MjData<Box<MjModel>>,
    renderer: MjRenderer,
}

impl Mujoco {
    /// For a studio's shot.
    ///
    /// # Errors
    /// [`Error::Device`] if there is no OpenGL without a screen; [`Error::Format`] if MuJoCo does not take the scene.
    pub fn new(studio: &Studio) -> Result<Self> {
        let text = model(studio.paper, studio.shot.environment, &studio.camera)?;
        let model = MjModel::from_xml_string(&text).map_err(Error::format("MuJoCo's model"))?;
        let _one_at_a_time = OPENING.lock();
        // The model's only camera; the picture's size is the model's, too.
        let renderer = MjRenderer::builder().camera(MjvCamera::new_fixed(0)).build(&model).map_err(failed)?;
        let data = MjData::try_new(Box::new(model)).map_err(Error::format("MuJoCo's model"))?;
        Ok(Self { size: studio.camera.size(), data, renderer })
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
}

fn failed(error: RendererError) -> Error {
    let cause = error.source().map_or_else(|| error.to_string(), ToString::to_string);
    let reason = format!("{cause}; MuJoCo needs OpenGL without a screen (EGL): scripts/mujoco installs Mesa's");
    Error::Device { device: "opengl".into(), reason }
}

/// The scene as MuJoCo reads it.
fn model(paper: &Paper, environment: Option<usize>, camera: &Camera) -> Result<String> {
    let (ball, light, head, material) = (&paper.ball, &paper.light, &paper.headlight, &paper.material);
    let (gravity, integrator, joint, things) = match environment {
        Some(environment) => (paper.bouncing.gravity, "Euler", String::new(), things(paper, environment)?),
        // A free joint's spring pulls towards where the model has the body, the origin. MuJoCo's usual semi-implicit
        // steps would be millimetres off; Runge and Kutta's follow the law.
        None => (0.0, "RK4", format!(r#"stiffness="{}""#, paper.spring.stiffness), String::new()),
    };
    let eye = camera.world_from_camera(&Point3::origin());
    let axis = |x, y| text((camera.world_from_camera(&Point3::new(x, y, 0.0)) - eye).as_slice());
    Ok(format!(
        r#"<mujoco>
<compiler angle="degree"/>
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
<geom type="sphere" size="{radius}" mass="{mass}" rgba="{colour} 1" solref="-{contact} 0"/>
</body>
</worldbody>
</mujoco>"#,
        down = -gravity,
        step = 1.0 / (paper.fps * SUBSTEPS),
        width = camera.size().width,
        height = camera.size().height,
        ambient = text(&[head.ambient; 3]),
        diffuse = text(&[head.diffuse; 3]),
        specular = text(&[head.specular; 3]),
        shine = material.specular,
        shininess = material.shininess / SHINIEST,
        reflectance = paper.bouncing.floor.reflectance,
        light_position = text(&light.position),
        light_direction = text(&light.direction),
        light_diffuse = text(&[light.diffuse; 3]),
        light_specular = text(&[light.specular; 3]),
        cutoff = light.cutoff,
        exponent = light.exponent,
        eye = text(eye.coords.as_slice()),
        right = axis(1.0, 0.0),
        up = axis(0.0, -1.0),
        field_of_view = paper.field_of_view,
        radius = ball.radius,
        mass = ball.mass,
        colour = text(&ball.colour),
        contact = paper.bouncing.stiffness,
    ))
}

/// What the ball can touch.
fn things(paper: &Paper, environment: usize) -> Result<String> {
    let colour = text(&paper.bouncing.floor.colour);
    let floor = format!(r#"<geom type="plane" size="{FLOOR} {FLOOR} .1" rgba="{colour} 1" material="mirror"/>"#);
    let boxes = paper.blocks(environment)?.iter().map(|block| {
        format!(
            r#"<geom type="box" pos="{}" size="{}" euler="0 0 {}" rgba="{} {}"/>"#,
            text(&block.position),
            text(&block.half_size),
            block.yaw,
            text(&block.colour),
            block.alpha
        )
    });
    Ok(std::iter::once(floor).chain(boxes).collect::<Vec<_>>().join("\n"))
}

/// Numbers as MuJoCo reads them.
fn text<T: ToString>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}
