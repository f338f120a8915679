// SPDX-License-Identifier: Apache-2.0
// Prints the newest state.
const socket = new WebSocket(`ws://${location.host}/ws`);
socket.onmessage = (event) => {
  const message = JSON.parse(event.data);
  if (message.type === "state") {
    document.getElementById("state").textContent = JSON.stringify(message, null, 1);
  }
};
