/** The camera, the place and the ball as a person chooses them: what is chosen, what is missing, and how to get it. */
import type { Job } from "../shared/job";
import type { Alert, Parts } from "../shared/panel";
import { workspace } from "../shared/workspace";
import { Assumed } from "./assumed";
import { Court } from "./court";
import { when, type SceneChoice } from "./scene-choice";
import type { Source } from "./sources";

interface With {
  part: Parts;
  alert: Alert;
  job: Job;
  sceneChoice: SceneChoice;
  /** What is open. */
  source: () => Source | undefined;
}

export class Setting {
  /** Settles when the last choice is taken: the core has a look at each. */
  settled: Promise<unknown> = Promise.resolve();
  readonly #with: With;
  readonly #changed: () => void;
  readonly #court: Court;
  readonly #assumed: Assumed;

  /** `changed` hears of another camera or place. */
  constructor(uses: With, changed: () => void) {
    this.#with = uses;
    this.#changed = changed;
    this.#court = new Court(uses);
    this.#assumed = new Assumed(uses);
    this.#listen();
  }

  #listen(): void {
    const { part, alert, sceneChoice } = this.#with;
    const onClick = (name: string, act: () => Promise<void> | void) => part(name).addEventListener("click", () => void alert.during(async () => act()));
    onClick("video-find", () => this.#court.find());
    onClick("video-check", () => this.#court.check());
    onClick("video-assume", () => this.#choose(() => this.#assumed.use()));
    onClick("video-assume-not", () => this.#choose(() => this.#assumed.forget()));
    onClick("video-forget-camera", () => this.#choose(() => sceneChoice.forgetCamera()));
    onClick("video-other-camera-forget", () => sceneChoice.forgetCamera());
    onClick("video-other-camera-use", () => workspace.cameraIsOf(sceneChoice.shown));
    const onChange = (name: string, act: (field: HTMLInputElement) => Promise<void>) =>
      part(name).addEventListener("change", (event) => void alert.during(() => this.#choose(() => act(event.currentTarget as HTMLInputElement))));
    onChange("video-sport", ({ value }) => sceneChoice.choose(value));
    onChange("video-ball", ({ valueAsNumber }) => sceneChoice.setRadius(valueAsNumber / 200));
    workspace.addEventListener("camera", () => {
      sceneChoice.cameraChanged();
      this.#changed();
      void this.takeSport();
    });
    workspace.addEventListener("scene", () => this.#changed());
  }

  async #choose(work: () => Promise<void> | void): Promise<void> {
    const chosen = Promise.resolve(work());
    this.settled = Promise.all([this.settled, chosen.catch(() => undefined)]);
    await chosen;
    this.#changed();
  }

  /** The step Calibrate knows the sport from the court. */
  takeSport(): Promise<void> {
    return this.#with.alert.during(async () => {
      if (await this.#with.sceneChoice.takeSport()) this.#changed();
    });
  }

  /** Another source: what was found or assumed for the last one is not its. */
  forget(): void {
    this.#court.forget();
    this.#assumed.forget();
  }

  show(): void {
    const { part, alert, sceneChoice } = this.#with;
    const { camera, scene, sport, summary, otherCamera } = sceneChoice;
    part("video-place").textContent = summary;
    part("video-forget-camera").hidden = !sceneChoice.canForgetCamera;
    part("video-other-camera").hidden = !otherCamera;
    if (otherCamera) part("video-other-camera-said").textContent = `This browser keeps a camera: ${otherCamera.from}, ${when(otherCamera.at)}. Use it here only if it stood in the same place with the same zoom.`;
    part("video-empty-camera").hidden = camera !== undefined;
    part("video-needs-camera").hidden = camera !== undefined || otherCamera !== undefined;
    this.#assumed.show();
    void alert.during(() => this.#court.showWhether());
    part("video-needs-ball").hidden = camera === undefined || scene !== undefined;
    part<HTMLSelectElement>("video-sport").value = sport;
    const ball = part<HTMLInputElement>("video-ball");
    ball.disabled = !scene || sceneChoice.example !== undefined;
    ball.value = scene ? String(Number((200 * scene.ball.radius).toFixed(2))) : "";
  }
}
