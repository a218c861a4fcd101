// Puts the page on a clock that stands still but for `flight.step`, and counts what it asks for. Runs before the page's own scripts.
window.flight = (() => {
  const wall = performance.now.bind(performance);
  const later = window.setTimeout.bind(window);
  const flight = { now: wall(), open: 0, waiting: [], callbacks: new Map(), next: 1 };
  performance.now = () => flight.now;
  window.requestAnimationFrame = (callback) => {
    flight.callbacks.set(flight.next, callback);
    return flight.next++;
  };
  window.cancelAnimationFrame = (number) => flight.callbacks.delete(number);
  // Time limits are the page's patience with a link, whose seconds are not the wall's here.
  window.setTimeout = (callback, delay, ...rest) => later(callback, delay >= 5000 ? 1000 * delay : delay, ...rest);

  const asked = window.fetch.bind(window);
  const done = () => void flight.open--;
  window.fetch = (url, init) => {
    // What the page has made itself no server is asked for.
    if (String(url.url ?? url).startsWith("blob:")) return asked(url, init);
    flight.open++;
    const answer = asked(url, init);
    answer.then((found) => {
      if (!found.ok) return done();
      const read = found.arrayBuffer.bind(found);
      found.arrayBuffer = () => read().finally(done);
    }, done);
    return answer;
  };

  const turn = () => new Promise((resolve) => later(resolve, 0));
  // One frame, `milliseconds` after the last: what it took by the wall until all was drawn, and the page's figures.
  // `drawn` false leaves the splats and triangles out of it.
  flight.step = (milliseconds, pose, drawn) => {
    flight.now += milliseconds;
    farfield.world.group.visible = drawn;
    if (pose) farfield.setCamera(pose);
    const began = wall();
    const callbacks = [...flight.callbacks.values()];
    flight.callbacks.clear();
    for (const callback of callbacks) callback(flight.now);
    const planned = wall();
    const gl = document.getElementById("picture").getContext("webgl2");
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    const took = { drawn_ms: wall() - began, script_ms: planned - began };
    return { ...farfield.stats(), ...took };
  };
  // Fulfilled when nothing that has come is waiting to be read or decoded; gives the requests that are open.
  flight.settle = async () => {
    do await turn();
    while (farfield.world.pool.pending > 0);
    await turn();
    return flight.open;
  };
  return flight;
})();
