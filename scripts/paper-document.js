// docs/paper.md from the numbers in docs/paper/*.json: the paper's tables with ours beside them.

// ---- what the paper has, cm (3DV 2024, main text and supplementary material) ----

const PAPER = {
  cameras: {
    "SD-S": { cam1: "22 ± 19" },
    "SD-M": { cam1: "19 ± 10", cam2: "19 ± 18", cam3: "28 ± 24", cam4: "13 ± 9", cam5: "26 ± 12", cam6: "19 ± 14", cam7: "27 ± 23", cam8: "23 ± 9", cam9: "21 ± 10" },
    "SD-L": { cam1: "11 ± 6", cam2: "20 ± 19", cam3: "28 ± 25", cam4: "11 ± 8", cam5: "10 ± 6", cam6: "19 ± 13", cam7: "28 ± 25", cam8: "15 ± 8", cam9: "16 ± 7" },
  },
  environments: { "SD-M": { env1: "22 ± 16" }, "SD-L": { env1: "18 ± 16", env2: "17 ± 16", env3: "18 ± 13" } },
  losses: {
    "2D-predict": { cam1: ["7 ± 4", "8, 6, 11"], cam2: ["6 ± 4", "4, 6, 11"] },
    "2D-gt": { cam1: ["18 ± 10", "6, 14, 33"], cam2: ["17 ± 10", "5, 15, 32"] },
    "3D-gt": { cam1: ["3 ± 3", "3, 2, 6"], cam2: ["3 ± 4", "3, 2, 6"] },
  },
  backbones: {
    resnet34: ["19 ± 10", "19 ± 18", "28 ± 24", "13 ± 9", "26 ± 12", "19 ± 14", "27 ± 23", "23 ± 9", "21 ± 10"],
    "convnext-nano": ["14 ± 12", "26 ± 21", "32 ± 27", "15 ± 13", "15 ± 11", "24 ± 21", "37 ± 31", "22 ± 11", "20 ± 12"],
    "convnextv2-nano": ["23 ± 14", "33 ± 28", "45 ± 32", "25 ± 20", "18 ± 11", "31 ± 27", "49 ± 36", "53 ± 22", "35 ± 20"],
  },
  spring: { numeric: ["9 ± 15", "6, 5, 16"], analytic: ["10 ± 16", "8, 4, 21"] },
  seeds: ["24 ± 20", "27 ± 21", "26 ± 21", "23 ± 19", "23 ± 21", "25 ± 21", "25 ± 19", "22 ± 21"],
};

// ---- pieces ----

const one = (value) => value.toFixed(1);
const dtg = (cell) => (cell ? `${one(cell.mean)} ± ${one(cell.std)}` : "–");
const median = (cell) => (cell ? one(cell.median) : "–");
const means = (bins) => bins.map((bin) => (bin ? one(bin.mean) : "–")).join(", ");
const minutes = (row) => (row.minutes === undefined ? "" : row.minutes < 10 ? one(row.minutes) : row.minutes.toFixed(0));
const table = (head, rows) => [head, head.map(() => "---"), ...rows].map((row) => `| ${row.join(" | ")} |`).join("\n");
const how = (name, { quick }) => `\`scripts/paper ${name}${quick ? " --quick" : ""}\``;

/** DtG by loss and by the noise of the labels. */
const byNoise = ({ rows }) => {
  const noises = [...new Set(Object.keys(rows).map((name) => name.split(" ")[1]))].sort();
  const kinds = [...new Set(Object.keys(rows).map((name) => name.split(" ")[0]))];
  return table(["loss", ...noises.map((noise) => `${noise} px`)], kinds.map((kind) => [kind, ...noises.map((noise) => dtg(rows[`${kind} ${noise}`]))]));
};

const CAMERAS = [1, 2, 3, 4, 5, 6, 7, 8, 9].map((number) => `cam${number}`);
/** Of the paper's synthetic scenes. */
const FRAMES_OF_CLIP = 90;

/** A curve as a small text chart's data: every so many steps the DtG. */
const curve = (points, count = 8) => {
  const step = Math.max(1, Math.floor(points.length / count));
  const some = points.filter((_, index) => index % step === step - 1 || index === points.length - 1);
  return some.map(([at, value]) => `${at}: ${value.toFixed(0)}`).join("; ");
};

// ---- the tables ----

const SECTIONS = {
  ways: [
    "The paper's way of learning",
    ({ rows }) =>
      table(
        ["", "test clips", "DtG, cm", "median", "2D error, px", "minutes", "on the way: DtG by step, cm (900 validation pictures of 10 clips)"],
        [["paper, SD-S", "100", "22 ± 19", "", "", "", ""], ...Object.entries(rows).map(([name, row]) => [name, row.n / FRAMES_OF_CLIP, dtg(row), median(row), row.px ? row.px.toFixed(2) : "", minutes(row), curve(row.curve ?? [])])],
      ),
  ],
  cameras: [
    "DtG by camera, environment 1",
    ({ rows }) =>
      table(
        ["", ...CAMERAS.map((name) => name.replace("cam", "")), "minutes"],
        [
          ...Object.entries(PAPER.cameras).map(([name, cells]) => [`paper, ${name}`, ...CAMERAS.map((camera) => cells[camera] ?? "–"), ""]),
          ...Object.entries(rows).map(([name, row]) => [name, ...CAMERAS.map((camera) => dtg(row.cameras[camera])), minutes(row)]),
        ],
      ),
  ],
  environments: [
    "DtG by environment, all nine cameras",
    ({ rows }) =>
      table(
        ["", "1", "2", "3"],
        [
          ...Object.entries(PAPER.environments).map(([name, cells]) => [`paper, ${name}`, ...["env1", "env2", "env3"].map((environment) => cells[environment] ?? "–")]),
          ...Object.entries(rows).map(([name, row]) => [name, ...["env1", "env2", "env3"].map((environment) => dtg(row.environments[environment]))]),
        ],
      ),
  ],
  rd: [
    "The real data set, and the rendered one in its place",
    ({ rows }) => {
      const cells = (row) => ["cam1", "cam2"].flatMap((camera) => [dtg(row.cameras[camera]), means(row.cameras[camera].bins)]);
      return table(
        ["", "camera 1", "in three bins of depth, 0.05–2 m", "camera 2", "in three bins", "minutes"],
        [
          ...Object.entries(PAPER.losses).map(([name, row]) => [`paper, real, ${name}`, ...row.cam1, ...row.cam2, ""]),
          ...Object.entries(rows).map(([name, row]) => [name, ...cells(row), minutes(row)]),
        ],
      );
    },
  ],
  losses: ["What forecasts are compared with, and the noise of the labels (SD-S)", byNoise],
  noise: ["The same on the rendered RD", byNoise],
  backbones: [
    "Backbones on SD-M, DtG by camera in environment 1 (ours with narrow heads, taught by fitted trajectories)",
    ({ rows }) =>
      table(
        ["", ...CAMERAS.map((name) => name.replace("cam", "")), "minutes"],
        Object.entries(rows).flatMap(([name, row]) => [
          ...(PAPER.backbones[name] ? [[`paper, ${name}`, ...PAPER.backbones[name], ""]] : []),
          [name, ...CAMERAS.map((camera) => dtg(row.cameras[camera])), minutes(row)],
        ]),
      ),
  ],
  spring: [
    "The ball on a spring: numeric and analytic forecasts",
    ({ rows }) =>
      table(
        ["", "paper", "in three bins of depth", "DtG, cm", "in three bins of depth", "2D error, px", "minutes"],
        Object.entries(rows).map(([name, row]) => [name, ...(PAPER.spring[name] ?? ["–", "–"]), dtg(row), means(row.bins), row.px.toFixed(2), minutes(row)]),
      ),
  ],
  seeds: [
    "Eight seeds of SD-S",
    ({ rows }) => {
      const ways = { loss: "the paper's loss", fit: "fitted trajectories, quick" };
      const about = (way) => {
        const all = Object.values(rows).flatMap((row) => (row[way] ? [row[way].mean] : []));
        if (all.length < 2) return "–";
        const mean = all.reduce((sum, value) => sum + value, 0) / all.length;
        const deviation = Math.sqrt(all.reduce((sum, value) => sum + (value - mean) ** 2, 0) / all.length);
        return `${mean.toFixed(1)} ± ${deviation.toFixed(1)}`;
      };
      return table(
        ["seed", "paper", ...Object.values(ways).flatMap((way) => [way, "minutes"])],
        [
          ...Object.entries(rows).map(([seed, row]) => [seed, PAPER.seeds[seed - 1], ...Object.keys(ways).flatMap((way) => [dtg(row[way]), row[way] ? minutes(row[way]) : ""])]),
          ["mean over the seeds and its deviation", "24.4 ± 1.6", ...Object.keys(ways).flatMap((way) => [about(way), ""])],
        ],
      );
    },
  ],
  discussion: [
    "What the paper discusses and does not measure",
    ({ rows }) => {
      const what = (row) => {
        if (row.models) return `\`sd-s\` ${dtg(row.models["sd-s"])}, \`any\` ${dtg(row.models.any)}; \`fit\` explains ${row.explained} of ${row.clips} clips`;
        if (row.correlation !== undefined) return `correlation ${row.correlation.toFixed(2)} with the scene's depth; off by ${(100 * row.error_relative.median).toFixed(0)} %, a constant by ${(100 * row.error_of_constant.median).toFixed(0)} %`;
        if (row.truth !== undefined) return `found ${row.found.toFixed(2)} from ${row.start} on, truly ${row.truth}; DtG ${one(row.dtg)}`;
        return `${dtg(row)}, median ${median(row)}`;
      };
      return table(["", "DtG, cm"], Object.entries(rows).map(([name, row]) => [name, what(row)]));
    },
  ],
};

/** docs/paper.md, and each table by itself. */
export function document(results, words = {}) {
  const printed = {};
  const parts = Object.entries(SECTIONS).map(([name, [title, body]]) => {
    const result = results[name];
    const said = words[name] ? `\n${words[name].trim()}\n` : "";
    if (!result) return `## ${title}\n\nNot run yet: ${how(name, { quick: false })}.\n${said}`;
    const runs = Object.values(result.rows).filter((row) => row.line);
    printed[name] = `${title}\n\n${body(result)}\n`;
    const lines = runs.length ? `\n<details><summary>What was run</summary>\n\n${Object.entries(result.rows).filter(([, row]) => row.line).map(([row, { line: fields }]) => `- ${row}: \`${fields.replaceAll("`", "")}\``).join("\n")}\n\n</details>\n` : "";
    return `## ${title}\n\n${how(name, result)}${result.quick ? " (short runs)" : ""}\n\n${body(result)}\n${said}${lines}`;
  });
  return { text: `${(words.intro ?? "").trim()}\n\n${parts.join("\n")}`, printed };
}
