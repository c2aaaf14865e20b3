// A service worker: what live pages run on is fetched once; pages that were read can be read without a network.
const fixed = (url) => /\/live\/[0-9a-f]{12}\//.exec(url)?.[0]; // a folder's name changes with what is in it
const here = (url) => url.startsWith(self.location.origin);

async function fetched(request) {
  const answer = await fetch(request);
  if (!answer.ok) return answer;
  const shelf = await caches.open("book");
  const version = fixed(request.url);
  if (version && request.url.endsWith("files.json"))
    for (const old of await shelf.keys()) if ((fixed(old.url) ?? version) !== version) await shelf.delete(old);
  await shelf.put(request, answer.clone());
  return answer;
}

async function respond(request) {
  const kept = await caches.match(request, { cacheName: "book", ignoreVary: true });
  if (kept && fixed(request.url)) return kept;
  return fetched(request).catch((error) => kept ?? Promise.reject(error));
}

self.oninstall = () => self.skipWaiting();
self.onactivate = (event) => event.waitUntil(self.clients.claim());
self.onmessage = (event) =>
  event.waitUntil(Promise.allSettled(event.data.filter(here).map((url) => fetched(new Request(url)))));
self.onfetch = (event) => {
  if (event.request.method === "GET" && here(event.request.url)) event.respondWith(respond(event.request));
};
