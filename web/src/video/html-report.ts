/** A report on a tracked video as one HTML file, which needs nothing else: no script, no other file. */
import { contextOf, make } from "../dom";

interface Content {
  /** The video's. */
  name: string;
  /** What a reader should know: a sentence each. */
  facts: string[];
  /** Parts of the page to take over. */
  parts: HTMLElement[];
  plots: Blob | undefined;
  /** The box of the picture with what is drawn over it. */
  frame: HTMLElement;
}

const STYLE = `
:root { color-scheme: light; font: 16px/1.5 system-ui, sans-serif; color: #151826; }
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.4rem; } figure { margin: 1rem 0; } img, svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; margin: 0.5rem 0 1.5rem; } caption { text-align: left; font-weight: 600; }
th, td { padding: 0.3rem 0.8rem 0.3rem 0; text-align: left; border-bottom: 1px solid #dde0ea; vertical-align: top; }
small, .vague, .quiet, figcaption, footer { color: #5a6075; } dt { font-weight: 600; } dd { margin: 0 0 0.5rem; }
svg.plan { max-height: 30rem; } .plan polyline { fill: none; stroke: #5a6075; vector-effect: non-scaling-stroke; }
.plan ellipse { fill: rgb(224 22 95 / 0.2); stroke: #e0165f; vector-effect: non-scaling-stroke; } .plan circle { fill: #e0165f; }
.verdict { font-size: 1.1rem; font-weight: 600; }`;

export async function reportOf({ name, facts, parts, plots, frame }: Content): Promise<string> {
  const page = document.implementation.createHTMLDocument(`${name}: gravisight`);
  page.documentElement.lang = "en";
  const charset = page.createElement("meta");
  charset.setAttribute("charset", "utf-8");
  page.head.prepend(charset);
  const [verdict, ...rest] = parts;
  const body = [
    make("h1", { text: name }),
    make("p", { class: "verdict", text: verdict?.textContent?.trim() ?? "" }),
    ...facts.map((text) => make("p", { text })),
    figure(pictureOf(frame), "The frame that was shown when the report was saved."),
    ...rest.map(taken),
    ...(plots ? [figure(await dataUrl(plots), "Position and speed over time. Dots: frame by frame. Lines: the fit. Dashed: bounces and hits.")] : []),
    make("footer", { text: `Made by gravisight in a browser, ${new Date().toLocaleString("en-GB", { dateStyle: "long", timeStyle: "short" })}. Positions in metres, z up; ± is 1 σ.` }),
  ];
  page.body.append(...body.map((node) => page.importNode(node, true)));
  // As text: a style element made here would be held against this page's own policy.
  return `<!doctype html>\n${page.documentElement.outerHTML.replace("</head>", `<style>${STYLE}</style></head>`)}\n`;
}

/** A copy of a part of the page: what only the page can do is text in it, and nothing is folded away. */
function taken(part: HTMLElement): HTMLElement {
  const copy = part.cloneNode(true) as HTMLElement;
  for (const button of copy.querySelectorAll("button")) button.replaceWith(button.textContent ?? "");
  for (const details of copy.querySelectorAll("details")) details.open = true;
  for (const hidden of copy.querySelectorAll("[hidden]")) hidden.remove();
  for (const element of [copy, ...copy.querySelectorAll<HTMLElement>("*")]) {
    for (const attribute of ["data-part", "tabindex", "hidden"]) element.removeAttribute(attribute);
  }
  return copy;
}

function figure(source: string, caption: string): HTMLElement {
  const image = make("img");
  image.src = source;
  image.alt = caption;
  return make("figure", {}, image, make("figcaption", { text: caption }));
}

/** What the canvases of a box show, one over the other, as a data URL. */
function pictureOf(frame: HTMLElement): string {
  const [picture, ...over] = [...frame.querySelectorAll("canvas")];
  const canvas = make("canvas");
  [canvas.width, canvas.height] = [picture?.width ?? 1, picture?.height ?? 1];
  const context = contextOf(canvas);
  for (const layer of [picture, ...over]) if (layer) context.drawImage(layer, 0, 0, canvas.width, canvas.height);
  return canvas.toDataURL("image/jpeg", 0.85);
}

function dataUrl(blob: Blob): Promise<string> {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.addEventListener("load", () => resolve(reader.result as string));
    reader.addEventListener("error", () => reject(reader.error ?? new Error("the plot could not be read")));
    reader.readAsDataURL(blob);
  });
}
