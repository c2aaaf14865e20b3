// A service worker: what live pages run on is fetched once; pages that were read can be read without a network.
const fixed = (url) => /\/live\/[0-9a-f]{12}\//.exec(url)?.[0]; // a folder's name changes with what is in it
const open = () => caches.open("book");

async function fetched(request) {
  const answer = await fetch(request);
  if (!answer.ok) return answer;
  const shelf = await open(), version = fixed(request.url);
  if (version && request.url.endsWith("files.json"))
    for (const old of await shelf.keys()) if ((fixed(old.url) ?? version) !== version) await shelf.delete(old);
  await shelf.put(request, answer.clone());
  return answer;
}

async function respond(request) {
  const kept = await (await open()).match(request, { ignoreVary: true });
  if (kept && fixed(request.url)) return kept;
  return fetched(request).catch((error) => { if (kept) return kept; throw error; });
}

self.addEventListener("install", () => self.skipWaiting());
self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));
self.addEventListener("message", (event) => event.waitUntil(Promise.allSettled(event.data.filter((url) => url.startsWith(self.location.origin)).map((url) => fetched(new Request(url))))));
self.addEventListener("fetch", (event) => {
  if (event.request.method === "GET" && event.request.url.startsWith(self.location.origin)) event.respondWith(respond(event.request));
});
