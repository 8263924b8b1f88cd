/** What the page vouches for where the browser asks (Trusted Types): its own markup, and scripts of its own origin. */

interface Factory {
  createPolicy(name: string, rules: { createHTML?: (markup: string) => string; createScriptURL?: (url: string) => string }): { createHTML(markup: string): string };
}

const factory = (globalThis as { trustedTypes?: Factory }).trustedTypes;
const policy = factory?.createPolicy("gravisight-page", { createHTML: (markup) => markup });

// Workers, the service worker among them, are started from addresses.
factory?.createPolicy("default", {
  createScriptURL: (url) => {
    if (new URL(url, location.href).origin !== location.origin) throw new TypeError(`${url} is not a script of this page`);
    return url;
  },
});

/** Markup that came with the page's code. */
export function markupOf(markup: string): string {
  return policy ? policy.createHTML(markup) : markup;
}
