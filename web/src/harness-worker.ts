/** For tests: a user's own Worker, which serves the package, answers messages of its own, and tells how large the core's memory is. */
import "gravisight/worker";

const memories: WebAssembly.Memory[] = [];
const { instantiate } = WebAssembly;
WebAssembly.instantiate = (async (...given: Parameters<typeof instantiate>) => {
  const made = (await instantiate(...given)) as WebAssembly.Instance | WebAssembly.WebAssemblyInstantiatedSource;
  const { exports } = "instance" in made ? made.instance : made;
  if (exports.memory instanceof WebAssembly.Memory) memories.push(exports.memory);
  return made;
}) as typeof instantiate;

addEventListener("message", ({ data }: MessageEvent<unknown>) => {
  if (data === "memories") postMessage({ memories: memories.map(({ buffer }) => buffer.byteLength) });
});

// Its own work, which may fail.
addEventListener("message", ({ data }: MessageEvent<{ throw?: string } | null>) => {
  const message = data?.throw;
  if (message) setTimeout(() => {
    throw new Error(message);
  });
});
