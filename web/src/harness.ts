/** For tests of the package itself in a browser. */
import * as gravisight from "gravisight";

/** A Worker of the user's, which does other things as well. */
const startWorker = () => new Worker(new URL("./harness-worker.ts", import.meta.url), { type: "module" });

Object.assign(window, { gravisight, startWorker });
