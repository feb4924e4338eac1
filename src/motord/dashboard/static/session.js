/** The token of this page: from the address, kept for a reload, and what the server says of it. */

const KEY = "motord.token";

/**
 * The token in an address, and the address without it.
 * @param {string} href
 * @returns {{token: string, clean: string}} token is "" if there is none
 */
export function tokenOf(href) {
  const url = new URL(href);
  const fragment = url.hash.slice(1);
  const named = new URLSearchParams(fragment).get("token");
  const inFragment = named ?? (/^[\w-]{16,}$/.test(fragment) ? fragment : "");
  const token = inFragment || url.searchParams.get("token") || "";
  url.searchParams.delete("token");
  if (inFragment || fragment.startsWith("token=")) url.hash = "";
  return { token, clean: url.href.replace(/#$/, "") };
}

/** Take the token out of the address bar. @returns {string} the token, "" if there is none */
export function takeToken() {
  const { token, clean } = tokenOf(location.href);
  if (token) {
    sessionStorage.setItem(KEY, token);
    history.replaceState(null, "", clean);
  }
  return token || sessionStorage.getItem(KEY) || "";
}

/**
 * Ask the server about the token.
 * @param {string} token
 * @returns {Promise<{status: "good" | "bad" | "unreachable", message: string}>}
 */
export async function checkToken(token) {
  if (!token) return { status: "bad", message: MISSING };
  try {
    const response = await fetch("session", {
      headers: { Authorization: `Bearer ${token}` },
      cache: "no-store",
      signal: AbortSignal.timeout(5000),
    });
    if (response.ok) return { status: "good", message: "" };
    if (response.status === 401 || response.status === 403) return { status: "bad", message: WRONG };
    return { status: "unreachable", message: `the page's server answers with ${response.status}` };
  } catch {
    return { status: "unreachable", message: "the page's server does not answer" };
  }
}

const OPEN = "Open the address that `motord dashboard` printed, with all that follows the #.";
const MISSING = `This page has no token. ${OPEN}`;
const WRONG =
  `The token of this page is not, or no longer, that of the server: it is made anew at each start of \`motord dashboard\`. ${OPEN}`;
