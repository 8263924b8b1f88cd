//! `--ball-radius` and `--ball`.

use anyhow::Result;
use clap::Args;
use gravisight::Scene;
use gravisight::internal::check_ball_radius;

/// The ball that a command measures.
#[derive(Debug, Args)]
pub struct BallArguments {
    /// Radius of the ball, m, for a model that measures apparent size, such as the built-in `any`.
    #[arg(long, value_name = "M")]
    ball_radius: Option<f64>,
    /// The ball: the name of a sport, or a radius in metres.
    #[arg(long, value_name = "SPORT|M", conflicts_with = "ball_radius")]
    ball: Option<String>,
}

impl BallArguments {
    /// The ball's radius, m, where it is given.
    ///
    /// # Errors
    /// It is no ball's in metres, or of no sport that is known.
    pub fn radius(&self) -> Result<Option<f64>> {
        let radius = match &self.ball {
            Some(ball) => Some(with_ball(Scene::new([0.0, 0.0, -9.81], 0.1), ball)?.ball.radius),
            None => self.ball_radius,
        };
        radius.map_or(Ok(()), check_ball_radius)?;
        Ok(radius)
    }
}

/// `scene` with the ball of `--ball BALL`: that of a sport, or its own with another radius, m.
pub fn with_ball(mut scene: Scene, ball: &str) -> Result<Scene> {
    let Ok(radius) = ball.parse::<f64>() else { return Ok(scene.with_ball(ball)?) };
    check_ball_radius(radius)?;
    scene.ball = scene.ball.with_radius(radius);
    Ok(scene)
}
