//! Balls of common sports.

use super::scene::{Ball, Contact, Scene};
use gravisight_geometry::error::{Error, Result};

/// A ball, and what it does on the ground of its sport.
struct Preset {
    name: &'static str,
    ball: Ball,
    contact: Contact,
}

/// Every ball, by name, with where its numbers come from.
///
/// `speed_max` is the fastest that was measured: table tennis 116 km/h, tennis 263 (Groth 2012; padel's ball and racket are no faster),
/// badminton 565, golf 388 (Guinness World Records); squash 282 (Pilley 2014); volleyball 138 (serves of the Nations League 2024);
/// baseball 198 (off a bat, MLB Statcast 2025; cricket's the same, for its bowlers reach 161); pickleball 110 (exhibition of 2024, and a
/// little more); football 211 (disputed; 183 is not). Basketball: what the longest shot (34.6 m, Guinness) asks for through the air.
const PRESETS: [Preset; 12] = [
    // ITTF 40+ ball; drag and lift from wind tunnels, bounces on a table. Source: ITTF laws 2.3 and technical leaflet T3 (40
    // mm, 2.7 g, rebound 24-26 cm from 30 cm); Achenbach 1972 (sphere below the drag crisis); up to 150 rev/s measured in
    // play.
    Preset {
        name: "table-tennis",
        ball: Ball {
            mass: 0.0027,
            drag_coefficient: 0.45,
            lift_coefficient: 0.6,
            inertia_factor: 0.6667,
            spin_sigma: Some(300.0),
            speed_max: Some(33.0),
            ..Ball::new(0.02)
        },
        contact: Contact::Bounce {
            restitution: 0.88,
            friction: 0.25,
            restitution_sigma: Some(0.07),
            friction_sigma: Some(0.2),
        },
    },
    // ITF type 2 ball on a hard court; clay: restitution 0.80, friction 0.75; grass: 0.70, 0.55. Source: ITF rules of
    // tennis, appendix I (6.54-6.86 cm, 56.0-59.4 g, rebound 135-147 cm from 254 cm); Mehta, Alam and Subic 2008 (drag
    // 0.6-0.7 in wind tunnels), Cross and Lindsey 2014 (0.507 +- 0.024 in flight); Cross 2002 (bounces).
    Preset {
        name: "tennis",
        ball: Ball {
            mass: 0.0577,
            drag_coefficient: 0.55,
            lift_coefficient: 0.9,
            inertia_factor: 0.55,
            spin_sigma: Some(170.0),
            speed_max: Some(74.0),
            ..Ball::new(0.0335)
        },
        contact: Contact::Bounce {
            restitution: 0.75,
            friction: 0.6,
            restitution_sigma: Some(0.1),
            friction_sigma: Some(0.2),
        },
    },
    // FIBA size 7 on a wooden floor; on a rim or board the restitution is lower. Source: FIBA equipment guide (75-77 cm
    // around, 580-620 g, rebound 104-109 cm from 180 cm); drag of a rough sphere above the crisis.
    Preset {
        name: "basketball",
        ball: Ball {
            mass: 0.6,
            drag_coefficient: 0.5,
            lift_coefficient: 0.5,
            inertia_factor: 0.6667,
            spin_sigma: Some(10.0),
            speed_max: Some(27.0),
            ..Ball::new(0.121)
        },
        contact: Contact::Bounce {
            restitution: 0.77,
            friction: 0.5,
            restitution_sigma: Some(0.1),
            friction_sigma: Some(0.25),
        },
    },
    // FIFA size 5 on a hard floor; on grass the restitution is 0.55-0.7. Source: IFAB law 2 (68-70 cm around, 410-450 g);
    // FIFA quality programme (rebound 135-155 cm from 200 cm on steel); Asai and others 2007 (drag and lift).
    Preset {
        name: "football",
        ball: Ball {
            mass: 0.43,
            drag_coefficient: 0.22,
            lift_coefficient: 1.0,
            inertia_factor: 0.6667,
            spin_sigma: Some(30.0),
            speed_max: Some(60.0),
            ..Ball::new(0.11)
        },
        contact: Contact::Bounce {
            restitution: 0.75,
            friction: 0.5,
            restitution_sigma: Some(0.15),
            friction_sigma: Some(0.25),
        },
    },
    // FIVB ball on an indoor floor. Source: FIVB rules 3.1 (65-67 cm around, 260-280 g); Asai and others 2010 (drag).
    Preset {
        name: "volleyball",
        ball: Ball {
            mass: 0.27,
            drag_coefficient: 0.3,
            lift_coefficient: 0.8,
            inertia_factor: 0.6667,
            spin_sigma: Some(20.0),
            speed_max: Some(39.0),
            ..Ball::new(0.105)
        },
        contact: Contact::Bounce {
            restitution: 0.75,
            friction: 0.5,
            restitution_sigma: Some(0.1),
            friction_sigma: Some(0.25),
        },
    },
    // MLB ball; bounces on hard ground. Source: MLB rule 3.01 (9-9.25 inches around, 5-5.25 oz); Nathan 2008 (drag 0.3-0.4,
    // lift against spin); coefficient of restitution 0.55 against wood.
    Preset {
        name: "baseball",
        ball: Ball {
            mass: 0.145,
            drag_coefficient: 0.35,
            lift_coefficient: 1.0,
            inertia_factor: 0.4,
            spin_sigma: Some(100.0),
            speed_max: Some(56.0),
            ..Ball::new(0.0369)
        },
        contact: Contact::Bounce {
            restitution: 0.5,
            friction: 0.5,
            restitution_sigma: Some(0.15),
            friction_sigma: Some(0.25),
        },
    },
    // Outdoor ball with 40 holes on a hard court. Source: USA Pickleball equipment standards manual (2.87-2.97 inches, 0.78-0.935 oz,
    // rebound 30-34 inches from 78 inches on granite); its drag is a sphere's below the crisis: no measurement is known.
    Preset {
        name: "pickleball",
        ball: Ball {
            mass: 0.0245,
            drag_coefficient: 0.45,
            lift_coefficient: 0.6,
            inertia_factor: 0.6667,
            spin_sigma: Some(100.0),
            speed_max: Some(33.0),
            ..Ball::new(0.0371)
        },
        contact: Contact::Bounce {
            restitution: 0.62,
            friction: 0.4,
            restitution_sigma: Some(0.1),
            friction_sigma: Some(0.25),
        },
    },
    // Tennis's ball with less pressure, on artificial grass. Source: FIP rules 2 (6.35-6.77 cm, 56.0-59.4 g, rebound 135-145 cm from
    // 254 cm); drag and lift as of a tennis ball, whose felt it has.
    Preset {
        name: "padel",
        ball: Ball {
            mass: 0.0577,
            drag_coefficient: 0.55,
            lift_coefficient: 0.9,
            inertia_factor: 0.55,
            spin_sigma: Some(120.0),
            speed_max: Some(74.0),
            ..Ball::new(0.0328)
        },
        contact: Contact::Bounce {
            restitution: 0.72,
            friction: 0.6,
            restitution_sigma: Some(0.1),
            friction_sigma: Some(0.2),
        },
    },
    // Men's ball on a turf pitch, which differs much from match to match. Source: MCC laws of cricket 4 (22.4-22.9 cm around,
    // 155.9-163.0 g); Mehta 2000 (aerodynamics; the seam's side force is not modelled).
    Preset {
        name: "cricket",
        ball: Ball {
            mass: 0.1595,
            drag_coefficient: 0.45,
            lift_coefficient: 0.8,
            inertia_factor: 0.4,
            spin_sigma: Some(100.0),
            speed_max: Some(56.0),
            ..Ball::new(0.036)
        },
        contact: Contact::Bounce {
            restitution: 0.5,
            friction: 0.4,
            restitution_sigma: Some(0.15),
            friction_sigma: Some(0.25),
        },
    },
    // R&A ball; bounces on a green. Source: R&A equipment rules 4 (at least 42.67 mm, at most 45.93 g); Bearman and Harvey
    // 1976 (drag and lift); Penner 2002 (bounces on turf).
    Preset {
        name: "golf",
        ball: Ball {
            mass: 0.0459,
            drag_coefficient: 0.27,
            lift_coefficient: 1.0,
            inertia_factor: 0.4,
            spin_sigma: Some(300.0),
            speed_max: Some(109.0),
            ..Ball::new(0.02134)
        },
        contact: Contact::Bounce {
            restitution: 0.4,
            friction: 0.4,
            restitution_sigma: Some(0.3),
            friction_sigma: Some(0.3),
        },
    },
    // a shuttle of goose feathers, as a sphere of its skirt's size with its drag; it turns over after a hit, which is not
    // modelled. Source: BWF laws of badminton 2 (4.74-5.50 g, skirt 58-68 mm); Cohen, Texier, Quere and Clanet 2015
    // (terminal speed 6.7 m/s).
    Preset {
        name: "badminton",
        ball: Ball {
            mass: 0.0052,
            drag_coefficient: 0.57,
            inertia_factor: 0.5,
            spin_sigma: Some(1.0),
            drag_sigma: Some(0.1),
            speed_max: Some(158.0),
            ..Ball::new(0.0325)
        },
        contact: Contact::Bounce {
            restitution: 0.2,
            friction: 0.6,
            restitution_sigma: Some(0.5),
            friction_sigma: Some(0.5),
        },
    },
    // WSF double yellow dot ball, warm, on walls and a wooden floor. Source: WSF specification of balls (39.5-40.5 mm, 23-25
    // g, rebound 26-33 % of 100 inches at 45 degrees Celsius); drag of a sphere below the crisis.
    Preset {
        name: "squash",
        ball: Ball {
            mass: 0.024,
            drag_coefficient: 0.5,
            lift_coefficient: 0.6,
            inertia_factor: 0.6,
            spin_sigma: Some(100.0),
            speed_max: Some(79.0),
            ..Ball::new(0.02)
        },
        contact: Contact::Bounce {
            restitution: 0.54,
            friction: 0.6,
            restitution_sigma: Some(0.15),
            friction_sigma: Some(0.25),
        },
    },
];

impl Scene {
    /// Names of the balls of common sports.
    pub fn ball_names() -> Vec<&'static str> {
        PRESETS.iter().map(|preset| preset.name).collect()
    }

    /// The scene with the ball of a common sport, and with that one's bounces where the scene says nothing of them (its
    /// contact is the ideal one). Where the numbers come from stands beside them in the source.
    ///
    /// # Errors
    /// [`Error::Value`] with the names there are.
    pub fn with_ball(mut self, name: &str) -> Result<Self> {
        let preset = PRESETS.into_iter().find(|preset| preset.name == name).ok_or_else(|| {
            Error::value("ball", "name", format!("cannot be `{name}`; choose one of {}", Self::ball_names().join(", ")))
        })?;
        self.ball = preset.ball;
        if self.contact == Contact::default() {
            self.contact = preset.contact;
        }
        Ok(self)
    }
}

impl Ball {
    /// The same ball with another radius, m. What it weighs nobody has said: its mass follows its cross-section, so that the air slows it as
    /// much as before. Balls of sports are hollow and do about that (a table tennis ball has 6.7 kg/m², a basketball 43, most others between).
    pub fn with_radius(self, radius: f64) -> Self {
        let ratio = radius / self.radius;
        Self { radius, mass: self.mass * ratio * ratio, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_slows_a_ball_of_another_radius_as_much() {
        let tennis = Scene::new([0.0, 0.0, -9.81], 0.1).with_ball("tennis").unwrap();
        let mut large = tennis.clone();
        large.ball = large.ball.with_radius(0.11);
        assert!((large.terminal_speed() / tennis.terminal_speed() - 1.0).abs() < 1e-12);
        // A football has 0.43 kg.
        assert!((0.4..0.7).contains(&large.ball.mass), "{} kg", large.ball.mass);
    }

    #[test]
    fn every_ball_makes_a_scene() {
        assert_eq!(Scene::ball_names().len(), 12);
        for name in Scene::ball_names() {
            let scene = Scene::new([0.0, 0.0, -9.81], 0.1).with_ball(name).unwrap();
            scene.check(name).unwrap();
            assert!(matches!(scene.contact, Contact::Bounce { restitution, .. } if restitution < 1.0), "{name}");
            assert!(scene.ball.spin_sigma.unwrap() * scene.ball.radius < 8.0, "{name}");
        }
        let error = Scene::new([0.0; 3], 0.1).with_ball("curling").unwrap_err().to_string();
        assert!(error.contains("table-tennis"), "{error}");
    }
}
