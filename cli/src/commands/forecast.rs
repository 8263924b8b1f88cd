//! `gravisight forecast`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::{ArgGroup, Args};
use nalgebra::{Matrix6, Point3, Vector3};
use serde_json::{Value, json};

use super::print_line;
use gravisight::internal::{Case, read_text};
use gravisight::{Forecast, ForecastOptions, Forecaster, Integrator, Scene};

/// Forecast where a ball will be: positions, velocities, and their derivatives with respect to the start.
#[derive(Args)]
#[command(group(ArgGroup::new("what").required(true).args(["scene", "cases"])))]
pub struct Arguments {
    /// The scene and its ball (scene.json).
    #[arg(long, value_name = "SCENE.JSON", requires = "state", requires = "times")]
    scene: Option<PathBuf>,
    /// Position (m) and velocity (m/s) at the start: x,y,z,vx,vy,vz.
    #[arg(long, value_name = "X,Y,Z,VX,VY,VZ", allow_hyphen_values = true, value_parser = six_numbers)]
    state: Option<Numbers>,
    /// Times after the start, s (negative: before it), in any order.
    #[arg(long, value_name = "T1,T2,…", allow_hyphen_values = true, value_parser = numbers)]
    times: Option<Numbers>,
    /// Print the 6×6 Jacobian d(state at t)/d(state at 0), too.
    #[arg(long)]
    jacobian: bool,
    /// Run the cases in this file instead (starts, times and systems in the paper's notation) and print them with their results as JSON.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["state", "times", "jacobian"])]
    cases: Option<PathBuf>,
    /// Relative tolerance of the solver, where no closed form is used; the absolute tolerance is one hundredth of it.
    #[arg(long, default_value_t = 1e-10, value_name = "RTOL", value_parser = tolerance)]
    tolerance: f64,
    /// Solve numerically even where there is a closed form.
    #[arg(long)]
    numeric: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Finite numbers, separated by commas.
#[derive(Debug, Clone)]
struct Numbers(Vec<f64>);

fn numbers(text: &str) -> std::result::Result<Numbers, String> {
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{part}` is not a finite number")),
    };
    text.split(',').map(number).collect::<std::result::Result<_, _>>().map(Numbers)
}

fn six_numbers(text: &str) -> std::result::Result<Numbers, String> {
    match numbers(text)? {
        Numbers(values) if values.len() == 6 => Ok(Numbers(values)),
        Numbers(values) => Err(format!("six numbers x,y,z,vx,vy,vz are needed, {} given", values.len())),
    }
}

fn tolerance(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("must be greater than zero".into()),
    }
}

pub fn run(arguments: Arguments) -> Result<()> {
    let rtol = arguments.tolerance;
    let integrator = Integrator::DormandPrince { rtol, atol: 0.01 * rtol };
    let options = ForecastOptions { integrator, closed_forms: !arguments.numeric, ..ForecastOptions::default() };
    if let Some(path) = &arguments.cases {
        return run_cases(path, options);
    }
    let path = arguments.scene.as_deref().context("--scene is missing")?;
    let (Numbers(state), Numbers(times)) =
        arguments.state.zip(arguments.times).context("--state and --times are missing")?;
    let &[x, y, z, vx, vy, vz] = state.as_slice() else { bail!("--state takes six numbers") };
    let forecaster = Forecaster::new(&Scene::open(path)?)?.with_options(options)?;
    let start = forecaster.scene().start(Point3::new(x, y, z), Vector3::new(vx, vy, vz));
    let forecast = match arguments.jacobian {
        true => forecaster.forecast_with_jacobians(&start, &times),
        false => forecaster.forecast(&start, &times),
    };
    match arguments.json {
        true => print_line(as_json(&forecast))?,
        false => print(&forecast)?,
    }
    if !forecast.status.is_whole() {
        bail!("the forecast stopped early: {}; check --state and the scene", forecast.status);
    }
    Ok(())
}

/// The cases of a file with `r`, `v`, `jacobian` and `status` filled in.
fn run_cases(path: &std::path::Path, options: ForecastOptions) -> Result<()> {
    let text = read_text(path)?;
    let what = path.display().to_string();
    let written: Value = serde_json::from_str(&text).with_context(|| what.clone())?;
    let cases = Case::all_from_json(&text, &what)?;
    let mut out = Vec::with_capacity(cases.len());
    for (index, case) in cases.iter().enumerate() {
        let forecaster = Forecaster::new(&case.scene)?.with_options(options)?;
        let forecast = forecaster.forecast_with_jacobians(&case.start, &case.times);
        let mut object = json!({"name": case.name, "times": forecast.times, "status": forecast.status.code()});
        for key in ["kind", "system", "r0", "v0"] {
            object[key] = written["cases"][index][key].clone();
        }
        (object["r"], object["v"], object["jacobian"]) = states(&forecast);
        out.push(object);
        if !forecast.status.is_whole() {
            eprintln!("gravisight: note: {what}: case `{}` stopped early: {}", case.name, forecast.status);
        }
    }
    Ok(print_line(json!({ "cases": out }))?)
}

/// Positions, velocities, Jacobians.
fn states(forecast: &Forecast) -> (Value, Value, Value) {
    let rows = |jacobian: &Matrix6<f64>| -> Vec<Vec<f64>> {
        jacobian.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    let r: Vec<Point3<f64>> = forecast.states.iter().map(|state| state.position).collect();
    let v: Vec<Vector3<f64>> = forecast.states.iter().map(|state| state.velocity).collect();
    (json!(r), json!(v), json!(forecast.jacobians.iter().map(rows).collect::<Vec<_>>()))
}

fn as_json(forecast: &Forecast) -> Value {
    let (r, v, jacobian) = states(forecast);
    let status = forecast.status.code();
    let mut object = json!({"times": forecast.times, "r": r, "v": v, "status": status, "impacts": forecast.impacts});
    if !forecast.jacobians.is_empty() {
        object["jacobian"] = jacobian;
    }
    if let Some(moved) = &forecast.moved {
        object["moved"] = json!(moved);
    }
    object
}

fn print(forecast: &Forecast) -> Result<()> {
    print_line("       t s          x          y          z m       vx         vy         vz m/s")?;
    for (index, (state, time)) in forecast.states.iter().zip(&forecast.times).enumerate() {
        let (r, v) = (state.position, state.velocity);
        print_line(format_args!(
            "{time:10.4} {:10.5} {:10.5} {:10.5} {:10.5} {:10.5} {:10.5}",
            r.x, r.y, r.z, v.x, v.y, v.z
        ))?;
        if let Some(jacobian) = forecast.jacobians.get(index) {
            for row in jacobian.row_iter() {
                let numbers: Vec<String> = row.iter().map(|value| format!("{value:10.5}")).collect();
                print_line(format_args!("           {}", numbers.join(" ")))?;
            }
        }
    }
    for impact in &forecast.impacts {
        print_line(format_args!("{:10.4} touches {} at {:.3} m/s", impact.time, impact.surface, impact.speed))?;
    }
    if let Some(moved) = &forecast.moved {
        print_line(format_args!(
            "note       the start was {:.3} m inside {} and was moved by {:.3} m",
            moved.depth,
            moved.surface,
            moved.by.norm()
        ))?;
    }
    if forecast.status.code() == "irreversible" {
        print_line(format_args!("note       {}", forecast.status))?;
    }
    Ok(())
}
