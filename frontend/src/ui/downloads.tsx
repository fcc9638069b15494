/** What can be taken away as files: a menu of links. */

import { Menu } from "@mantine/core";
import { Icon } from "./icons";

export interface Download {
  label: string;
  about: string;
  /** Below /api/v1/. */
  path: string;
  name: string;
  testId: string;
}

export function Downloads({ files }: { files: readonly Download[] }) {
  return (
    <Menu position="bottom-end" width={300}>
      <Menu.Target>
        <button type="button" className="btn" data-testid="export">
          <Icon name="download" />
          Export
        </button>
      </Menu.Target>
      <Menu.Dropdown>
        {files.map((file) => (
          <Menu.Item
            key={file.path}
            component="a"
            href={`/api/v1/${file.path}`}
            download={file.name}
            data-testid={file.testId}
          >
            {file.label}
            <span className="m about">{file.about}</span>
          </Menu.Item>
        ))}
      </Menu.Dropdown>
    </Menu>
  );
}
