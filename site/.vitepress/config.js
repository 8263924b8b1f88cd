/** The site of the markdown files, which stay where they are: the README is its first page. `scripts/docs` builds it. */
import { existsSync, readFileSync } from "node:fs";
import { dirname, join, relative, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { defineConfig } from "vitepress";

const root = fileURLToPath(new URL("../..", import.meta.url));
const { version, repository } = JSON.parse(readFileSync(join(root, "pkg/package.json"), "utf8"));
/** Where the sources can be looked at: a forge's builds know it. Without it their names are no links. */
const { GITHUB_SERVER_URL: server, GITHUB_REPOSITORY: name } = process.env;
const forge = repository?.url?.replace(/^git\+|\.git$/g, "") ?? (name && `${server}/${name}`);

const page = (text, link) => ({ text, link });
const sidebar = [
  {
    text: "Begin",
    items: [
      page("Start here", "/docs/start"),
      page("Recipes by task", "/docs/recipes"),
      page("How accurate", "/docs/accuracy"),
      page("Troubleshooting", "/docs/troubleshooting"),
    ],
  },
  {
    text: "Guides",
    items: [
      page("A camera from clicks or another tool", "/docs/cameras"),
      page("A ball in a picture", "/docs/any"),
      page("From a video to metres", "/docs/video"),
      page("From a 2D track to metres", "/docs/real"),
      page("Your own ball", "/docs/your-own-ball"),
      page("Many videos", "/docs/many-videos"),
      page("Training", "/docs/training"),
      page("In a web page", "/docs/in-a-web-page"),
      page("Programs for web pages and Node.js", "/docs/web"),
    ],
  },
  {
    text: "Reference",
    items: [
      page("Files, commands and results", "/docs/formats"),
      page("npm package", "/pkg/"),
      { ...page("npm package: every symbol", "/api/js/index.html"), target: "_self" },
      page("Changelog", "/CHANGELOG"),
    ],
  },
  {
    text: "Models",
    collapsed: true,
    items: [page("All models", "/models/"), ...["any", "sd-s", "sd-s-1px", "sd-s-future", "sd-m", "sd-l", "spring"].map((each) => page(each, `/models/${each}`))],
  },
  {
    text: "Behind it",
    collapsed: true,
    items: [
      page("How it works", "/docs/how-it-works"),
      page("The paper's tables", "/docs/paper"),
      page("Experiments", "/docs/experiments"),
      page("Architecture", "/ARCHITECTURE"),
      page("Contributing", "/CONTRIBUTING"),
      page("Security", "/SECURITY"),
    ],
  },
];

/** Heading anchors as GitHub makes them, so that one link is right in both places. */
const slugify = (heading) => heading.trim().toLowerCase().replace(/[^\p{L}\p{N}\s_-]/gu, "").replaceAll(" ", "-");

/** Links to what is no page lead to the forge, or are none; a link to what does not exist stops the build. */
function linkSources(md) {
  md.core.ruler.push("link-sources", ({ tokens, env }) => {
    for (const { children } of tokens) {
      const open = [];
      for (const token of children ?? []) {
        if (token.type === "link_close") token.tag = open.pop().tag;
        if (token.type !== "link_open") continue;
        open.push(token);
        token.attrSet("href", token.attrGet("href").replace(/(^|\/)README\.md/, "$1index.md"));
        const [path] = token.attrGet("href").split("#");
        if (!path || /^(\w+:|\/)/.test(path) || path.endsWith(".md")) continue;
        const target = resolve(dirname(env.realPath ?? env.path), path);
        if (!existsSync(target)) throw new Error(`${env.path}: a link to ${path}, which does not exist`);
        if (forge) token.attrSet("href", `${forge}/blob/main/${relative(root, target)}`);
        else Object.assign(token, { tag: "span", attrs: null });
      }
    }
  });
}

/** The pages lie outside of the folder in which Vue is installed. */
const vueOfPages = {
  name: "vue-of-pages",
  enforce: "pre",
  resolveId(id, importer) {
    return /^vue($|\/)/.test(id) && importer?.endsWith(".md") ? this.resolve(id, fileURLToPath(import.meta.url)) : null;
  },
};

export default defineConfig({
  title: "gravisight",
  description: "A ball's position in metres from a single picture of one calibrated camera, and its flight from a video",
  lang: "en",
  srcDir: root,
  srcExclude: ["{cli,fuzz,site,src,target,tests,web}/**", "docs/paper/**"],
  rewrites: { "README.md": "index.md", "pkg/README.md": "pkg/index.md", "models/README.md": "models/index.md" },
  // Another build puts these pages beside ours.
  ignoreDeadLinks: [/^\/api\/js\//],
  outDir: join(root, "site/dist"),
  cacheDir: join(root, "site/node_modules/.cache"),
  head: [
    ["link", { rel: "icon", href: `data:image/svg+xml,${encodeURIComponent(readFileSync(join(root, "web/public/ball.svg"), "utf8"))}` }],
    ["style", {}, "html:root { --vp-code-lang-color: var(--vp-c-text-2) }"],
  ],
  markdown: {
    anchor: { slugify },
    config: linkSources,
    languageAlias: { "rust,no_run": "rust" },
    theme: { light: "github-light-high-contrast", dark: "github-dark-high-contrast" },
  },
  vite: { publicDir: false, logLevel: "warn", plugins: [vueOfPages] },
  themeConfig: {
    nav: [page("Start here", "/docs/start"), page("Recipes", "/docs/recipes"), page("Troubleshooting", "/docs/troubleshooting"), page(version, "/CHANGELOG")],
    sidebar,
    outline: [2, 3],
    search: { provider: "local" },
    ...(forge ? { socialLinks: [{ icon: "github", link: forge }] } : {}),
  },
});
