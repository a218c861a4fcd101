// Pictures of a flight (flights.js): what is shown, and what would be with the cells and tiles of the frame before.
(() => {
  const { world } = farfield;
  const canvas = document.getElementById("picture");
  let camera = null;
  let plan = null;
  const update = world.update.bind(world);
  world.update = (given, ...rest) => update((camera = given), ...rest);
  const shown = () => canvas.toDataURL("image/png");
  const draw = (chosen, fade) => {
    const { session, renderer, frame } = world;
    const [kept, faded] = [session.plan, frame.fade];
    session.plan = chosen;
    frame.fade = fade;
    session.draw(camera, world.largestPoint, canvas.width);
    world.show(session, camera, true);
    renderer.render(world.parent, camera);
    session.plan = kept;
    frame.fade = faded;
  };
  window.steady = {
    keep: () => void (plan = world.session.plan),
    // The drawing buffer is gone by now: the same is shown once more.
    picture: () => {
      world.renderer.render(world.parent, camera);
      return shown();
    },
    held: () => {
      draw(plan, 0);
      const picture = shown();
      world.invalidate();
      return picture;
    },
  };
})();
